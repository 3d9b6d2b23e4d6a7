"""The ladders of scenes, one difficulty each in five rungs; imports `stress` and `modelling`."""
