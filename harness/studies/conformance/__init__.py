"""Whether a method keeps the contract of the catalogue."""
