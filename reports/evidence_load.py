"""OUT/evidence.json → a record of which every figure may be trusted to be what its type says."""

from collections import Counter
from pathlib import Path

from harness.evidence_record import EVIDENCE_FILE, Effect, EvidenceRecord, StudyRecord, read_evidence
from harness.record_types import first_mismatch
from reports.load import find_record, uneven

REMEDY = "run `nox -s evidence` again"


def find_evidence(out: Path) -> EvidenceRecord | None:
    """The evidence under `out`, None where there is none; raises `DamagedRecord`."""
    return find_record(out / EVIDENCE_FILE, EvidenceRecord, read_evidence, _contradiction, REMEDY)


def _contradiction(record: EvidenceRecord) -> str | None:
    """The first thing that no run writes, though every type is right."""
    interest = record.settings.get("smallest_of_interest")
    if interest is not None and (wrong := first_mismatch(interest, dict[str, float], "smallest_of_interest")):
        return wrong
    twice = [name for name, many in Counter(study.info.id for study in record.studies).items() if many > 1]
    if twice:
        return f"study {twice[0]!r} is there twice"
    for study in record.studies:
        wrong = uneven(study.series, study.tables) or _stray(study)
        if wrong is not None:
            return f"study {study.info.id!r}: {wrong}"
    return None


def _stray(study: StudyRecord) -> str | None:
    """A line or table of another chapter would be shown nowhere; an interval that runs backwards says nothing."""
    items = {one.name: one.item for one in study.series} | {one.title: one.item for one in study.tables}
    lost = next((name for name, item in items.items() if item != 0), None)
    if lost is not None:
        return f"{lost!r} belongs to item {items[lost]}, not 0"
    return next(filter(None, map(_backwards, study.effects)), None)


def _backwards(one: Effect) -> str | None:
    for name in ("interval", "simultaneous"):
        pair = getattr(one, name)
        if pair is not None and pair[0] > pair[1]:
            return f"effect {one.name!r} on {one.scene!r} has {name} {list(pair)}, which runs backwards"
    return None
