"""What will be done: profiles, settings, schedule, seeds, plugins; imports `machine`, `records` and below."""
