"""This machine and this code: cores, device, clocks, provenance; imports `records` and the rooms below it."""
