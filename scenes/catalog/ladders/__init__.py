"""Ladders of five scenes, each with one growing difficulty; imports `stress` and `modelling`."""
