"""Cases in which methods train on rendered scenes."""
