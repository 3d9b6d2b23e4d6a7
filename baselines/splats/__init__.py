"""Three-dimensional Gaussians, drawn one after the other instead of being asked along rays."""
