"""One method learns one scene; imports `run_folder`, `plan`, `machine`, `records` and the rooms below it."""
