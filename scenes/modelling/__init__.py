"""Solids, surfaces, lights, and what a scene needs, as plain data; imports `view_sets` and what is below."""
