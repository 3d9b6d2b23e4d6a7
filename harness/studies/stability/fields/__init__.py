"""Cases of a field in training: amplifier, units, optimiser."""
