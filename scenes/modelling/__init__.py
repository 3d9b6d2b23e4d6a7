"""Solids, surfaces, lights, and the needs of a scene, as plain data; imports `view_sets` and the rooms below it."""
