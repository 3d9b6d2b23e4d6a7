"""Methods as records of their settings; imports the parts in `baselines`."""
