"""The plan of a run: profiles, settings, schedule, seeds, plugins; imports `machine`, `records` and the rooms below."""
