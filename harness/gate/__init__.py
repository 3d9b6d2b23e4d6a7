"""Regression gates: what this code gives now against limits that were measured and reviewed (`gates/limits.json`)."""
