"""What `nox -s speed` leaves behind: `speed.json`, every figure with its spread and, where there is one, its target.

This module imports the standard library, `harness.records.cells` and `harness.records.charts` alone, as reports read
it.
"""

from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from harness.records.charts import Series, Table
from harness.records.json_record import DamagedRecord, load_record, sound, write_record

SPEED_SCHEMA = 1


@dataclass(frozen=True)
class Measurement:
    """One figure, measured several times inside one run."""

    id: str
    """Stable and dotted: `training.dense.ratio`."""
    item: int
    """Number of the question that it answers (`QUESTIONS`)."""
    title: str
    value: float | None
    """The median; None where it could not be measured, and `detail` says why."""
    unit: str
    """`×` for a ratio, `%` for a share, else a unit."""
    low: float | None = None
    """Smallest and largest of the repetitions."""
    high: float | None = None
    repeats: int = 1
    target: float | None = None
    sense: Literal["at_least", "at_most"] = "at_least"
    detail: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None without a target or a value."""
        if self.target is None or self.value is None:
            return None
        return self.value >= self.target if self.sense == "at_least" else self.value <= self.target


QUESTIONS: dict[int, str] = {
    1: "Training throughput at the paper's network",
    2: "Share of the machine's matrix rate",
    3: "Time to a target PSNR",
    4: "Full-frame rendering",
    5: "Encodings",
    6: "Quadrature",
    7: "Ground truth by Mitsuba variant",
    8: "Peak memory",
    9: "How the cost grows",
    10: "Several processes on all cores",
    11: "What each acceleration gains",
}


@dataclass(frozen=True)
class SpeedRecord:
    """One run of `nox -s speed`."""

    provenance: dict[str, Any]
    settings: dict[str, Any]
    measurements: list[Measurement] = field(default_factory=list)
    series: list[Series] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    """Wall seconds by question, and `total`."""
    schema: int = SPEED_SCHEMA


def write_speed(path: Path, record: SpeedRecord) -> None:
    """`record` as JSON; each measurement also says whether its target is met."""
    data = asdict(record)
    for row, one in zip(data["measurements"], record.measurements, strict=True):
        row["met"] = one.met
    write_record(path, data)


def read_speed(path: Path) -> SpeedRecord:
    """Raises `DamagedRecord` where the file cannot be read, and where it is not what this version writes."""
    try:
        data = load_record(path)
        if data.get("schema") != SPEED_SCHEMA or set(data) != {one.name for one in fields(SpeedRecord)}:
            raise ValueError(f"not a speed record of schema {SPEED_SCHEMA}")
        for row in data["measurements"]:
            row.pop("met", None)
        made = {
            "measurements": [Measurement(**row) for row in data["measurements"]],
            "series": [Series(**row) for row in data["series"]],
            "tables": [Table(**row) for row in data["tables"]],
        }
        return sound(SpeedRecord(**{**data, **made}), SpeedRecord)
    except OSError as error:
        raise DamagedRecord(f"{path}: {error.strerror}; name a speed.json that `nox -s speed` wrote") from error
    except (ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise DamagedRecord(f"{path}: {error}; run `nox -s speed` again") from error
