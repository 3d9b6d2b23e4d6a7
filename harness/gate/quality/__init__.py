"""Short trainings against the stored ones: errors of their means, limits of losses; imports `gate`."""
