"""The studies that a verdict rests on."""
