"""Records in, tables, plots and pages out; imports `harness.records`, `harness.verdicts` and `scenes.files`."""
