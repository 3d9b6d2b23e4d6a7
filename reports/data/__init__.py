"""Records into data frames, and numbers into text; imports no other room of reports."""
