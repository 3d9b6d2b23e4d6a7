"""Estimates, their errors and adjusted p-values: pure functions on arrays and lists; imports no other room."""
