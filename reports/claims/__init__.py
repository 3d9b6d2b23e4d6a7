"""The printed numbers, judged; imports `studies` and the rooms below it."""
