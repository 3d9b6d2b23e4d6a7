"""Pure statistics on records; imports `records`, and neither torch nor Mitsuba."""
