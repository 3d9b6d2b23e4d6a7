"""Trainers of what is no network: each has a model of its own, and imports what that needs."""
