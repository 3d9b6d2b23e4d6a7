"""The catalogue of scenes, ours and those of a file; imports `modelling` and the rooms below it."""
