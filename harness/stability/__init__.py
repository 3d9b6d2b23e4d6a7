"""What `nox -s stability` tries: the catalogue of stiff and extreme cases, on everything they apply to."""
