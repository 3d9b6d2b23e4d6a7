"""Default intervals, limits and sizes."""

KEPT_EVERY = 60.0
"""The wall seconds, outside the training clock, between two snapshots of unfinished cells."""
RENDER_LIMIT = 1800.0
"""The seconds that a view may take to render; one of 800 pixels and 256 samples takes some minutes on one slow core."""
SERVING_WIDTH = 100
"""The width in pixels at which a run measures view cache and attention; at most that of its views."""
SERVING_SECONDS, SERVING_SHARE = 240.0, 0.05
"""The time that a run may spend on that: seconds, or a share of its other time, whichever is more."""
PLAIN_SECONDS, QUICK_PLAIN_SECONDS = 420.0, 1.5
"""The training seconds of the plain program in question 3 of the speed study."""
