"""Commands: parse, call, exit code; imports every room, each when its command is called."""
