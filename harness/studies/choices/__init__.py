"""What a setting changes: searches, accelerations, omissions; imports `frontier` and the rooms below it."""
