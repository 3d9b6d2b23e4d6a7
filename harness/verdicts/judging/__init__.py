"""Judgement of any table of results, and comparison of two runs of a plan."""
