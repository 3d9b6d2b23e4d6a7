"""Radiance fields whose features are learnt where they lie in space, read by a small network."""
