"""The records of studies in the output folder of a run, which its report shows too."""

from dataclasses import dataclass

from harness.records.study import Studies


@dataclass(frozen=True)
class ShelfRecords:
    stability: Studies | None = None
    evidence: Studies | None = None
    serving: Studies | None = None


NO_SHELVES = ShelfRecords()
