"""Pure functions on tensors: no device, no configuration, no files, random generators as arguments."""
