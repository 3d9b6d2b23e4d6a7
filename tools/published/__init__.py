"""The numbers of README.md and docs, from the published files; imports reports, verdicts and records."""
