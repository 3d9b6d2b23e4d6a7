"""The printed numbers, judged; imports `studies` and what is below."""
