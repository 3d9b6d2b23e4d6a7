"""What may lie beside a run's records in its folder and stands in its report: each measured by itself, or not."""

from dataclasses import dataclass

from harness.records.evidence_record import EvidenceRecord
from harness.records.serving_record import ServingRecord
from harness.records.stability_record import StabilityRecord


@dataclass(frozen=True)
class Beside:
    """None is what was not measured."""

    stability: StabilityRecord | None = None
    evidence: EvidenceRecord | None = None
    serving: ServingRecord | None = None


ALONE = Beside()
