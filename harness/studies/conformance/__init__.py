"""Checks of the contract that every method keeps; imports `studies` itself and the rooms below it."""
