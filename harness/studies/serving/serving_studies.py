"""The studies of what serving a trained method costs and gives: view cache (§8.1), attention (§8.2)."""

from harness.studies.framework import Shelf, Study, asking, catalogue

STUDIES: dict[str, Study] = catalogue(
    asking("latency", "A view from the cache",
           "How much sooner does a view come from the cache than from rendering, and what must its key distinguish?",
           "Rendering and hits are timed in turn. A hit is what a caller waits for: the key of a new camera, lookup, "
           "checksum, array; weights were hashed before. Then the same poses are requested after one thing has "
           "changed. Stale: a key of the pose alone (Listing 5) was known, with another picture stored for it. Errors "
           "are the root mean square of display colour.",
           "view_cache:latency", 9),
    asking("attention", "Error while a picture is refined",
           "Does rendering by attention (Eq. 7) show a useful picture sooner, and what does its factor φ change?",
           "A coarse frame, then regions in some order until the picture is complete; plain rendering has no coarse "
           "frame and the largest chunks. Errors are those of display colour against the finished plain picture: over "
           "all of it and over the most attended quarter of the regions. An order is earlier if it is earlier in all "
           "repeats. φ is taken out of the priorities of every map.",
           "attention:attention", 25),
)  # fmt: skip
SHELF = Shelf("serving", "studies", STUDIES, in_run_folder=True, replaces=True)
