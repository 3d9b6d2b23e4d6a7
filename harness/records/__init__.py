"""The records that a run leaves, which `reports` reads; imports numpy and `scenes.files`."""
