"""Records into frames, and numbers into words; imports no other room of reports."""
