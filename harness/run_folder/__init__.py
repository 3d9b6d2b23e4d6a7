"""An output folder that survives kills; imports `plan`, `records` and what is below."""
