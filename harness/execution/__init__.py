"""Many cells, here or on a Ray cluster; imports `training` and what is below."""
