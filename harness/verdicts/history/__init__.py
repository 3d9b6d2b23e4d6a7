"""Figures of many runs, and when they changed."""
