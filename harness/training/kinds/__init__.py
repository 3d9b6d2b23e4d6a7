"""Trainers of models that are not networks; each imports what its model needs."""
