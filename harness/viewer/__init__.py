"""A finished run in the browser, and films of it; imports `playback` and the rooms below it."""
