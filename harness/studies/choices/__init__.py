"""What a setting changes: searches and omissions; imports `frontier` and the rooms below it."""
