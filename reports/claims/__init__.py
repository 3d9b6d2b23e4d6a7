"""Verdicts on printed numbers, and the first screen; imports `studies` and the rooms below it."""
