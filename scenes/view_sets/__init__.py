"""Posed images on disk, ours and those of other programs; imports `files`."""
