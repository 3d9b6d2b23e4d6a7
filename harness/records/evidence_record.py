"""What `nox -s evidence` leaves behind: `evidence.json`, one entry a study.

This module imports the standard library and modules of records alone, as reports read it.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from harness.records.cells import Estimate, estimate_of, with_pairs
from harness.records.charts import Series, Table, with_gaps
from harness.records.json_record import DamagedRecord, load_record, sound, write_record

EVIDENCE_SCHEMA = 1
EVIDENCE_FILE = "evidence.json"

Verdict = Literal["better", "worse", "equivalent", "inconclusive"]


@dataclass(frozen=True)
class Check:
    """Something that must hold before a reader may trust the rest: a figure between two limits."""

    what: str
    """In a few words: `share of A/A comparisons that are called better or worse`."""
    figure: float | None
    """None where nothing could be measured: `why` says so, and the check fails."""
    low: float | None = None
    high: float | None = None
    unit: str = ""
    why: str = ""
    """How it was measured, or why there is no figure."""

    @property
    def holds(self) -> bool:
        if self.figure is None:
            return False
        return (self.low is None or self.figure >= self.low) and (self.high is None or self.figure <= self.high)


@dataclass(frozen=True)
class Effect:
    """A difference with its interval: of one method from another, of a part, or of an interaction of parts."""

    name: str
    """What is added, changed or taken away: a method's name where it is one method against another."""
    against: str
    """A method's name; empty for a main effect or an interaction, which is against its own absence."""
    scene: str
    """A scene's name, or `all`."""
    metric: str
    """psnr, ssim, …"""
    budget: Literal["steps", "seconds"]
    difference: float | None
    interval: tuple[float, float] | None
    """95 %, of this comparison alone."""
    simultaneous: tuple[float, float] | None
    """The one that the verdict is taken from: as many are looked at together as `family` says."""
    family: int
    verdict: Verdict
    smallest_detectable: float | None
    pairs: int
    unpaired: int
    """Pairs without a score, because a cell diverged, collapsed or failed: the others are judged."""
    note: str = ""
    on_these_scenes: Estimate | None = None
    """With error from seeds alone. What stands beside the difference itself is of scenes like these where several were
    tried."""


@dataclass(frozen=True)
class StudyInfo:
    """A study as the report introduces it."""

    id: str
    title: str
    question: str
    """One sentence that ends with a question mark."""
    method: str
    """How it is answered, in two or three sentences; scenes, steps and seeds stand in `StudyRecord.scale`."""


@dataclass(frozen=True)
class StudyRecord:
    """One study and everything that came of it. `Series.item` and `Table.item` are 0 throughout."""

    info: StudyInfo
    scale: str = ""
    """At which it was measured, in one line: scenes, seeds, steps, pixels."""
    findings: list[str] = field(default_factory=list)
    """Sentences made from the figures, the answer first."""
    checks: list[Check] = field(default_factory=list)
    effects: list[Effect] = field(default_factory=list)
    series: list[Series] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    seconds: float = 0.0


@dataclass(frozen=True)
class EvidenceRecord:
    """The studies that are whole, in the order of the table of studies."""

    provenance: dict[str, Any]
    settings: dict[str, Any]
    studies: list[StudyRecord] = field(default_factory=list)
    finished: bool = False
    schema: int = EVIDENCE_SCHEMA

    def study(self, name: str) -> StudyRecord | None:
        return next((one for one in self.studies if one.info.id == name), None)

    def checks(self) -> Iterator[tuple[StudyRecord, Check]]:
        return ((study, check) for study in self.studies for check in study.checks)


def failed_checks(record: EvidenceRecord) -> list[tuple[StudyRecord, Check]]:
    """What must hold and does not."""
    return [(study, check) for study, check in record.checks() if not check.holds]


def write_evidence(path: Path, record: EvidenceRecord) -> None:
    """`record` as JSON; a point of a line that is not finite is kept as a gap, a table's as words.

    Raises `ValueError` where another figure is not finite.
    """
    data = asdict(record)
    for study in data["studies"]:
        with_gaps(study)
    write_record(path, data)


def read_evidence(path: Path) -> EvidenceRecord:
    """Raises `DamagedRecord` where the file is not what this version writes."""
    try:
        data = load_record(path)
        if data.get("schema") != EVIDENCE_SCHEMA or set(data) != {one.name for one in fields(EvidenceRecord)}:
            raise ValueError(f"not an evidence record of schema {EVIDENCE_SCHEMA}")
        return sound(EvidenceRecord(**{**data, "studies": [_study(row) for row in data["studies"]]}), EvidenceRecord)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise DamagedRecord(f"{path}: {error}; run `nox -s evidence` again") from error


def _study(row: dict[str, Any]) -> StudyRecord:
    return StudyRecord(
        **{
            **row,
            "info": StudyInfo(**row["info"]),
            "checks": [Check(**one) for one in row["checks"]],
            "effects": [_effect(one) for one in row["effects"]],
            "series": [Series(**one) for one in row["series"]],
            "tables": [Table(**one) for one in row["tables"]],
        }
    )


def _effect(row: dict[str, Any]) -> Effect:
    return Effect(**{**with_pairs(row), "on_these_scenes": estimate_of(row["on_these_scenes"])})
