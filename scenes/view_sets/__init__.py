"""Posed images on disk, rendered here or by other programs; imports `files`."""
