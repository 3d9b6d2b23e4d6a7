"""OUT/speed.json → a record of which every figure may be trusted to be what its type says."""

from pathlib import Path

from harness.speed_record import SpeedRecord, read_speed
from reports.load import find_record, uneven

FILE = "speed.json"
REMEDY = "run `nox -s speed` again"


def find_speed(out: Path) -> SpeedRecord | None:
    """The speed record under `out`, None where there is none; raises `DamagedRecord`."""
    return find_record(out / FILE, SpeedRecord, read_speed, lambda one: uneven(one.series, one.tables), REMEDY)


def is_quick(record: SpeedRecord) -> bool:
    return bool(record.settings.get("quick"))
