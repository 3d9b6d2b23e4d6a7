"""A finished run in the browser; imports `playback` and what is below."""
