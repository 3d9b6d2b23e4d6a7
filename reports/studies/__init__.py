"""The results of studies as sections and pages; imports `page` and the rooms below it."""
