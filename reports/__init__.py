"""Records → tables, plots, one HTML page. Knows neither torch nor Mitsuba."""
