"""Questions answered by measurement, one shelf each; imports `viewer` and the rooms below it."""
