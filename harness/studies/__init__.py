"""How a question is measured, and a shelf for each kind of question; imports `viewer` and the rooms below it."""
