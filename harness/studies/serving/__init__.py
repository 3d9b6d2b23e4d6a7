"""View cache, attention and first frame, measured on a finished run; imports `studies` itself and the rooms below."""
