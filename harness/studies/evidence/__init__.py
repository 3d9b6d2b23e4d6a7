"""The studies that a verdict rests on; imports `speed` and the rooms below it."""
