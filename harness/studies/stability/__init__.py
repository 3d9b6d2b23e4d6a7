"""The catalogue of stiff and extreme cases."""
