"""Three-dimensional Gaussians, drawn one after the other instead of sampled along rays."""
