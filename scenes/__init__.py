"""What is seen: procedural scenes, cameras, rendering of view sets, and their format on disk.

Importing this package does not import Mitsuba; only `scenes.render` does.
"""
