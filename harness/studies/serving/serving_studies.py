"""The one table of studies of what serving a trained method costs and gives: view cache (§8.1), attention (§8.2)."""

from harness.studies.framework import Shelf, Study, asking, catalogue

STUDIES: dict[str, Study] = catalogue(
    asking("latency", "A view from the cache",
           "How much sooner is a view there if it comes from the cache?",
           "Rendering, and hits of every kind, are timed in turn. A hit is what a caller waits for: the key of a new "
           "camera, lookup, checksum, array; weights were hashed before. A file that is not in the system's memory: "
           "its data were dropped from there; its name was not, nor what the disk itself remembers.",
           "cache_latency:latency", 6),
    asking("confusions", "What a key has to tell apart",
           "Which pictures does a key of the pose alone (Listing 5) take for each other?",
           "The same poses are asked for after one thing has changed. Stale: the key was known, with another picture "
           "behind it. Errors are the root mean square of display colour.",
           "cache_confusions:confusions", 5),
    asking("anytime", "Error while a picture is refined",
           "Does rendering by attention (Eq. 7) show a useful picture sooner?",
           "A coarse frame, then regions in some order, until all is there; plain rendering has no coarse frame, and "
           "chunks as large as any. Errors are those of display colour against the finished plain picture: of all of "
           "it, of the quarter of the regions in which the coarse frame is most wrong, and of that which is attended "
           "most. Earlier is what is so in all repeats.",
           "anytime:anytime", 27),
    asking("samples", "Samples shared out by attention",
           "Is a picture less wrong if attended regions get more samples?",
           "The same field with as many samples in all, shared out by attention, with what it costs to find out, "
           "against the same number for each ray. Errors are those of display colour, against the finely integrated "
           "field and against the ground truth.",
           "allocations:samples", 15),
    asking("priorities", "The factor φ of Eq. 7",
           "What does the factor φ change?",
           "Order and allocation of every attention map by Eq. 7's priorities, and by shares, which lack the factor.",
           "attention_views:priorities", 1),
)  # fmt: skip
SHELF = Shelf("serving", "studies", STUDIES, beside=True, anew=True)
