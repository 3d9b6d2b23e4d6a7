"""What every method is held to, whoever wrote it: the catalogue in the tests, a user's package by one command."""
