"""The Ray cluster: its connection, nodes, files and messages; imports `execution.group` and the rooms below."""
