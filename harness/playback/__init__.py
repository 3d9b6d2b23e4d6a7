"""A finished run, rendered again: cameras, the view cache, progressive frames; imports `training` and rooms below."""
