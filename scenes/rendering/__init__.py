"""Mitsuba renders scenes into view sets; imports `catalog` and the rooms below it."""
