"""OUT/speed.json → a record of which every figure may be trusted to be what its type says."""

from pathlib import Path

from harness.records import DamagedRecord
from harness.speed_record import SpeedRecord, read_speed
from reports.load import first_mismatch, uneven

FILE = "speed.json"
REMEDY = "run `nox -s speed` again"


def find_speed(out: Path) -> SpeedRecord | None:
    """The speed record under `out`, None where there is none; raises `DamagedRecord`."""
    path = out / FILE
    if not path.is_file():
        return None
    record = read_speed(path)
    wrong = first_mismatch(record, SpeedRecord) or uneven(record.series, record.tables)
    if wrong is not None:
        raise DamagedRecord(f"{path}: {wrong}; {REMEDY}")
    return record


def is_quick(record: SpeedRecord) -> bool:
    return bool(record.settings.get("quick"))
