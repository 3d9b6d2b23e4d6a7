"""A finished run in the browser; imports `playback` and the rooms below it."""
