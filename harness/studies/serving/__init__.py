"""View cache, attention and first frame, measured on a finished run."""
