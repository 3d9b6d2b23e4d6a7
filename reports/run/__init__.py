"""The page of a run, of several outputs, of a judgement; imports `claims` and the rooms below it."""
