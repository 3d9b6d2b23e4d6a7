"""Questions that are measured, a shelf each; imports `viewer` and what is below."""
