"""Posed images in the formats of other trainers; imports `view_sets` and `files`."""
