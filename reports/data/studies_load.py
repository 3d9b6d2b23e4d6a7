"""Records of the studies → records of which every figure may be trusted to be what its type says."""

from collections import Counter
from pathlib import Path

from harness.records.evidence_record import EVIDENCE_FILE, Effect, EvidenceRecord, StudyRecord, read_evidence
from harness.records.json_record import first_mismatch
from harness.records.speed_record import SpeedRecord, read_speed
from harness.records.stability_record import STABILITY_FILE, StabilityRecord, read_stability
from reports.data.load import find_record, uneven

EVIDENCE_REMEDY = "run `nox -s evidence` again"


def find_evidence(out: Path) -> EvidenceRecord | None:
    """The evidence under `out`, None where there is none; raises `DamagedRecord`."""
    return find_record(out / EVIDENCE_FILE, EvidenceRecord, read_evidence, _evidence_contradiction, EVIDENCE_REMEDY)


def _evidence_contradiction(record: EvidenceRecord) -> str | None:
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


FILE = "speed.json"
SPEED_REMEDY = "run `nox -s speed` again"


def find_speed(out: Path) -> SpeedRecord | None:
    """The speed record under `out`, None where there is none; raises `DamagedRecord`."""
    return find_record(out / FILE, SpeedRecord, read_speed, lambda one: uneven(one.series, one.tables), SPEED_REMEDY)


def is_quick(record: SpeedRecord) -> bool:
    return bool(record.settings.get("quick"))


STABILITY_REMEDY = "run `nox -s stability` again"


def find_stability(out: Path) -> StabilityRecord | None:
    """The stability record under `out`, None where there is none; raises `DamagedRecord`."""
    return find_record(
        out / STABILITY_FILE, StabilityRecord, read_stability, _stability_contradiction, STABILITY_REMEDY
    )


def _stability_contradiction(record: StabilityRecord) -> str | None:
    """The first thing that no run writes, though every type is right."""
    twice = [name for name, many in Counter(case.info.id for case in record.cases).items() if many > 1]
    if twice:
        return f"case {twice[0]!r} is there twice"
    for case in record.cases:
        stray = next((one.case for one in case.outcomes if one.case != case.info.id), None)
        if stray is not None:
            return f"case {case.info.id!r} holds an outcome of case {stray!r}"
        wrong = uneven(case.series, case.tables)
        if wrong is not None:
            return f"case {case.info.id!r}: {wrong}"
    return None
