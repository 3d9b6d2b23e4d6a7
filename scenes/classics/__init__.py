"""Procedural analogues of the eight scenes of the NeRF synthetic set (Table 2 of the paper)."""
