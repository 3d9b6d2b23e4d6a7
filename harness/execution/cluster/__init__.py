"""The Ray cluster: joining it, its nodes, files and messages; imports `execution.group` and the rooms below it."""
