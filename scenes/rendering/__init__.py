"""Mitsuba renders scenes into view sets; imports `catalog` and what is below."""
