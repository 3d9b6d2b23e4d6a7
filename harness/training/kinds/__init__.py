"""Trainers of models that are not networks; each imports the libraries of its model."""
