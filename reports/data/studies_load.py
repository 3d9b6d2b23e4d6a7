"""Records of the studies → records with every figure checked against its type."""

from collections import Counter
from pathlib import Path

from harness.records.json_record import DamagedRecord, as_promised
from harness.records.study import SHELVES, Effect, Studies, again, read_studies
from reports.data.load import uneven


def find_studies(out: Path, shelf: str) -> Studies | None:
    """The studies of a shelf under `out`, or `None` where there are none; raises `DamagedRecord`."""
    path = out / SHELVES[shelf]
    if not path.is_file():
        return None
    record = read_studies(path)
    if (problem := _contradiction(record, shelf)) is not None:
        raise DamagedRecord(f"{path}: {problem}; {again(shelf, out)}")
    return record


def _contradiction(record: Studies, shelf: str) -> str | None:
    """The first thing that no run writes, though every type is right."""
    if record.shelf != shelf:
        return f"holds studies of {record.shelf!r}"
    interest = record.settings.get("smallest_of_interest")
    try:
        as_promised(interest, dict[str, float] | None)
    except ValueError as error:
        return f"smallest_of_interest: {error}"
    twice = [name for name, many in Counter(study.info.id for study in record.studies).items() if many > 1]
    if twice:
        return f"{twice[0]!r} is there twice"
    for study in record.studies:
        wrong = uneven(study.series, study.tables) or next(filter(None, map(_backwards, study.effects)), None)
        if wrong is not None:
            return f"{study.info.id!r}: {wrong}"
    return None


def _backwards(one: Effect) -> str | None:
    """Return what is wrong with an interval that runs backwards: it says nothing."""
    for name in ("interval", "simultaneous"):
        pair = getattr(one, name)
        if pair is not None and pair[0] > pair[1]:
            return f"effect {one.name!r} on {one.scene!r} has {name} {list(pair)}, which runs backwards"
    return None
