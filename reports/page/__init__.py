"""The parts that all pages share: shell, tables, script, style; imports `drawing` and `data`."""
