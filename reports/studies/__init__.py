"""What studies found, as sections and pages; imports `page` and what is below."""
