"""Methods as choices of parts; imports the parts in `baselines`."""
