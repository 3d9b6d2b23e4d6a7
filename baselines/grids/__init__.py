"""Radiance fields of features that are learnt at places in space and read by a small network."""
