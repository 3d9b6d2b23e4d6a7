"""The training of methods on scenes; imports `run_folder`, `plan`, `machine`, `records` and the rooms below them."""
