"""What is seen, and the images of it on disk; imports no other room of ours, and Mitsuba only in `rendering`."""
