"""An output folder that survives kills; imports `plan`, `records` and the rooms below them."""
