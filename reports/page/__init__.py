"""The common parts of every page: shell, tables, script, style; imports `drawing` and `data`."""
