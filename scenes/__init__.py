"""The scenes and their images on disk; imports no other room of ours, and Mitsuba only in `rendering`."""
