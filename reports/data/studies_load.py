"""Records of the studies → records with every figure checked against its type."""

from collections import Counter
from pathlib import Path

from harness.records.json_record import as_promised
from harness.records.study import SHELVES, Studies, StudyRecord, again, read_studies
from reports.data.load import find_record, uneven


def find_studies(out: Path, shelf: str) -> Studies | None:
    """Return the studies of a shelf under `out`, or `None` if there are none; raises `DamagedRecord`."""
    path = out / SHELVES[shelf]
    return find_record(path, read_studies, lambda record: _contradiction(record, shelf), again(shelf, out))


def _contradiction(record: Studies, shelf: str) -> str | None:
    """Return the first thing that no run writes, though every type is right."""
    if record.shelf != shelf:
        return f"holds studies of {record.shelf!r}"
    try:
        as_promised(record.settings.get("smallest_of_interest"), dict[str, float] | None)
    except ValueError as error:
        return f"smallest_of_interest: {error}"
    twice = [name for name, many in Counter(study.info.id for study in record.studies).items() if many > 1]
    if twice:
        return f"{twice[0]!r} is there twice"
    for study in record.studies:
        wrong = uneven(study.series, study.tables) or _stray(study, shelf)
        if wrong is not None:
            return f"{study.info.id!r}: {wrong}"
    return None


def _stray(study: StudyRecord, shelf: str) -> str | None:
    """Return a line or table of another chapter, which would be shown nowhere, or an interval that runs backwards."""
    items = {one.name: one.item for one in study.series} | {one.title: one.item for one in study.tables}
    for name, item in items.items():
        if shelf == "evidence" and item != 0:
            return f"{name!r} belongs to item {item}, not 0"
    for one in study.effects:
        for name, pair in (("interval", one.interval), ("simultaneous", one.simultaneous)):
            if pair is not None and pair[0] > pair[1]:
                return f"effect {one.name!r} on {one.scene!r} has {name} {list(pair)}, which runs backwards"
    return None
