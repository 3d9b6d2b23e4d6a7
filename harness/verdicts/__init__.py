"""Pure statistics on records; imports only `records` and `scenes.files`."""
