"""Default intervals, limits and sizes."""

KEPT_EVERY = 60.0
"""The wall seconds, outside the training clock, between two snapshots of unfinished cells."""
RENDER_LIMIT = 1800.0
"""The seconds that a view may take to render; one of 800 pixels and 256 samples takes some minutes on one slow core."""
PLAIN_SECONDS, QUICK_PLAIN_SECONDS = 420.0, 1.5
"""The training seconds of the plain program in question 3 of the speed study."""
BEST_PAIRS = 3
"""The number of pairs of constants of each method that a longer search carries over."""
PICK_SECONDS = 60.0
"""The core seconds for which `study frontier --pick` chooses."""
