"""What may lie beside a run's records in its folder and stands in its report: each measured by itself, or not."""

from dataclasses import dataclass

from harness.records.serving_record import ServingRecord
from harness.records.study import Studies


@dataclass(frozen=True)
class Beside:
    """None is what was not measured."""

    stability: Studies | None = None
    evidence: Studies | None = None
    serving: ServingRecord | None = None


ALONE = Beside()
