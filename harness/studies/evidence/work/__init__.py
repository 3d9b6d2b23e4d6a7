"""Error against time: of rendering a field, and of the ground truth."""
