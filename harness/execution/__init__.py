"""Many cells, here or on a Ray cluster; imports `training` and the rooms below it."""
