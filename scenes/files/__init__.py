"""Errors, stopping, digests and folders that are complete or absent; imports nothing of ours."""
