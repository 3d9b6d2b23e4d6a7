"""A camera path through a finished run, as a film; imports `playback` and the rooms below it."""
