"""What every page shares: shell, tables, script, style; imports `drawing` and `data`."""
