"""Anybody's results: a table of them judged, and two runs of a plan compared."""
