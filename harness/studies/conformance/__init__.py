"""Checks of the contract that every method of the catalogue keeps."""
