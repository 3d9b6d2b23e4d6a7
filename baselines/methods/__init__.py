"""Methods as records of all that is their own; imports the parts in `baselines`."""
