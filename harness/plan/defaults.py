"""Default intervals, limits and sizes."""

KEPT_EVERY = 60.0
"""The wall seconds, outside the training clock, after which unfinished cells are kept."""
RENDER_LIMIT = 1800.0
"""The seconds that a view may take to render; one of 800 pixels and 256 samples takes some minutes on one slow core."""
SERVING_WIDTH = 100
"""The width in pixels, or that of the run's views if smaller, of the pictures of view cache and
attention after a run.
"""
SERVING_SECONDS, SERVING_SHARE = 240.0, 0.05
"""The time that a run may spend on them: so many seconds, or this share of its own time if that is more."""
PLAIN_SECONDS, QUICK_PLAIN_SECONDS = 420.0, 1.5
"""The training of the plain side of the speed study's question 3, on its own clock."""
