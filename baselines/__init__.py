"""The methods under comparison and the pure numerics that they are composed of.

Knows torch, not Mitsuba, not files.
"""
