"""Procedural analogues of the eight scenes of the paper's Table 2; imports `modelling`."""
