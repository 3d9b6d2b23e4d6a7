"""This machine and this code: cores, device, clocks, provenance; imports `records` and what is below."""
