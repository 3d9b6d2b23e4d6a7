"""Errors, stopping, digests, locks, and files and folders that are complete or absent; imports no other room."""
