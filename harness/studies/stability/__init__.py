"""The catalogue of stiff and extreme cases; imports `choices` and the rooms below it."""
