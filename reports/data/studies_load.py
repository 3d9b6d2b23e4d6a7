"""Read the records of studies in an output folder, and check that they do not contradict themselves."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from harness.records.json_record import as_promised
from harness.records.study import SHELVES, Studies, StudyRecord, again, read_studies
from scenes.files.errors import DamagedRecord


@dataclass(frozen=True)
class ShelfRecords:
    """The records that the report of a run shows too."""

    stability: Studies | None = None
    evidence: Studies | None = None
    serving: Studies | None = None


NO_SHELVES = ShelfRecords()


def find_studies(out: Path, shelf: str) -> Studies | None:
    """Return the studies of a shelf, if there are any; raises `DamagedRecord` also if they contradict themselves."""
    path = out / SHELVES[shelf]
    if not path.is_file():
        return None
    record = read_studies(path)
    for contradiction in _contradictions(record, shelf):
        raise DamagedRecord(f"{path}: {contradiction}; {again(shelf, out)}")
    return record


def _contradictions(record: Studies, shelf: str) -> Iterator[str]:
    if record.shelf != shelf:
        yield f"holds studies of {record.shelf!r}"
    try:
        if (of_interest := record.settings.get("smallest_of_interest")) is not None:
            as_promised(of_interest, dict[str, float])
    except ValueError as error:
        yield f"smallest_of_interest: {error}"
    for name, many in Counter(study.info.id for study in record.studies).items():
        if many > 1:
            yield f"{name!r} is there twice"
    for study in record.studies:
        for words in _in_study(study, shelf):
            yield f"{study.info.id!r}: {words}"


def _in_study(study: StudyRecord, shelf: str) -> Iterator[str]:
    """Yield lists of unequal length, items of a chapter that is not shown, and intervals that run backwards."""
    for line in study.series:
        for name in ("y", "low", "high"):
            values = getattr(line, name)
            if values is not None and len(values) != len(line.x):
                yield f"series {line.name!r} has {len(line.x)} x but {len(values)} {name}"
    for table in study.tables:
        for row in table.rows:
            if len(row) != len(table.columns):
                yield f"table {table.id!r} has {len(table.columns)} columns but a row of {len(row)}"
    items = {line.name: line.item for line in study.series} | {table.title: table.item for table in study.tables}
    for name, item in items.items():
        if shelf == "evidence" and item != 0:
            yield f"{name!r} belongs to item {item}, not 0"
    for effect in study.effects:
        for name, pair in (("interval", effect.interval), ("simultaneous", effect.simultaneous)):
            if pair is not None and pair[0] > pair[1]:
                yield f"effect {effect.name!r} on {effect.scene!r} has {name} {list(pair)}, which runs backwards"
