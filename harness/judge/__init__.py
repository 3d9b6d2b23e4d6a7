"""`python -m harness judge`: verdicts on somebody else's table of results; nothing is trained."""
