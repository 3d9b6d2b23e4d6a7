"""One difficulty each, in five rungs; imports `stress` and `modelling`."""
