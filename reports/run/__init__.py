"""The page of a run, and the page that compares several outputs; imports `claims` and the rooms below it."""
