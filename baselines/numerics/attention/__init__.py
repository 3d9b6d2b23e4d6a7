"""Eq. 7 as pure arrays: regions, priorities, maps; imports only numpy."""
