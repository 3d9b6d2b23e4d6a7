"""Which scenes there are, ours and those of a file; imports `modelling` and what is below."""
