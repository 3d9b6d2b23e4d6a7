"""Estimates, their errors and adjusted p-values: pure functions on arrays and lists, which import none of ours."""
