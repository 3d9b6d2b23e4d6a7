"""Short trainings compared with the stored ones: errors of their means, limits of losses; imports `gate`."""
