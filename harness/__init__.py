"""Who trains what on what, for how long, and what comes of it; imports `baselines` and `scenes`."""
