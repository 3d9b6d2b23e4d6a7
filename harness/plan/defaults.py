"""How often, how long and how much, where nobody says otherwise."""

KEPT_EVERY = 60.0
"""Seconds on the wall's clock, off that of the training, after which unfinished cells are kept."""
RENDER_LIMIT = 1800.0
"""Seconds that a view may take to render; one of 800 pixels and 256 samples takes some minutes of one slow core."""
SERVING_WIDTH = 100
"""Pixels, or those of the run's views where they are fewer: of the pictures of view cache and attention after a run."""
SERVING_SECONDS, SERVING_SHARE = 240.0, 0.05
"""What a run may spend on them: so many seconds, or so much of its own time where that is more."""
