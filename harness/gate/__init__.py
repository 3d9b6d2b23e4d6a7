"""Gates that detect whether anything has changed, and whether it is worse. Imports `studies` and the rooms below it."""
