"""Has anything changed, and is it worse? Imports `studies` and what is below."""
