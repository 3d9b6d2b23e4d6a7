"""OUT/speed.json → a record of which every figure may be trusted to be what its type says."""

from pathlib import Path

from harness.chart_record import Series, Table
from harness.records import DamagedRecord
from harness.speed_record import SpeedRecord, read_speed
from reports.load import first_mismatch

FILE = "speed.json"
REMEDY = "run `nox -s speed` again"


class NotForPublishing(ValueError):
    """A speed record whose figures are too rough to be shown to others."""


def find_speed(out: Path) -> SpeedRecord | None:
    """The speed record under `out`, None where there is none; raises `DamagedRecord`."""
    path = out / FILE
    if not path.is_file():
        return None
    record = read_speed(path)
    wrong = first_mismatch(record, SpeedRecord) or _uneven(record)
    if wrong is not None:
        raise DamagedRecord(f"{path}: {wrong}; {REMEDY}")
    return record


def is_quick(record: SpeedRecord) -> bool:
    return bool(record.settings.get("quick"))


def refuse_quick(record: SpeedRecord, out: Path) -> None:
    """Raises `NotForPublishing` for a record of a quick run."""
    if is_quick(record):
        raise NotForPublishing(
            f"{out / FILE}: a quick run, too rough to publish; measure again without --quick, or leave out --publish"
        )


def _uneven(record: SpeedRecord) -> str | None:
    """The first list that is longer or shorter than its partner."""
    found = [*map(_uneven_series, record.series), *map(_uneven_table, record.tables)]
    return next(filter(None, found), None)


def _uneven_series(one: Series) -> str | None:
    for name in ("y", "low", "high"):
        values = getattr(one, name)
        if values is not None and len(values) != len(one.x):
            return f"series {one.name!r} has {len(one.x)} x but {len(values)} {name}"
    return None


def _uneven_table(one: Table) -> str | None:
    wrong = next((row for row in one.rows if len(row) != len(one.columns)), None)
    return None if wrong is None else f"table {one.id!r} has {len(one.columns)} columns but a row of {len(wrong)}"
