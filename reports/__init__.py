"""Records → tables, figures, one self-contained page. Knows `harness.records` alone: no torch, no Mitsuba."""
