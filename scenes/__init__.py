"""The scenes and their images on disk; imports no other package here, and Mitsuba only in `rendering`."""
