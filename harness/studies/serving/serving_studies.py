"""The studies of what serving a trained method costs and gives: view cache (§8.1), attention (§8.2)."""

from harness.studies.framework import Shelf, Study, asking, catalogue

STUDIES: dict[str, Study] = catalogue(
    asking("latency", "A view from the cache",
           "How much sooner does a view come from the cache than from rendering?",
           "Rendering and hits of every kind are timed in turn. A hit is what a caller waits for: the key of a new "
           "camera, lookup, checksum, array; weights were hashed before. A file that is not in the system's memory had "
           "its data dropped from there, but not its name; the disk's own cache is not cleared.",
           "cache_latency:latency", 6),
    asking("confusions", "What a key has to distinguish",
           "Which pictures does a key that holds only the pose (Listing 5) confuse?",
           "The same poses are requested after one thing has changed. Stale: the key was known, with another picture "
           "stored for it. Errors are the root mean square of display colour.",
           "cache_confusions:confusions", 5),
    asking("anytime", "Error while a picture is refined",
           "Does rendering by attention (Eq. 7) show a useful picture sooner?",
           "A coarse frame, then regions in some order until the picture is complete; plain rendering has no coarse "
           "frame and the largest chunks. Errors are those of display colour against the finished plain picture: over "
           "all of it and over the most attended quarter of the regions. An order is earlier if it is earlier in all "
           "repeats.",
           "anytime:anytime", 27),
    asking("priorities", "The factor φ of Eq. 7",
           "What does the factor φ change?",
           "Order and allocation of every attention map by Eq. 7's priorities, and by shares, which have no factor.",
           "attention_views:priorities", 1),
)  # fmt: skip
SHELF = Shelf("serving", "studies", STUDIES, in_run_folder=True, replaces=True)
