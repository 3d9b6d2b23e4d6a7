"""Families of radiance fields compared at equal core seconds, with intervals; imports `evidence` and below."""
