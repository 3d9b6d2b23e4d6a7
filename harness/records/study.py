"""Records of studies, `OUT/<shelf>.json`: questions that are answered by measurement, in one form for all shelves.

A finding is a sentence, a check against limits, an effect, a line, a table or a picture; the first sentence of a study
is its answer.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Literal, TypedDict, Unpack

import msgspec
from msgspec import field

from harness.records.cells import Budget, Estimate
from harness.records.former.four_words import in_two_words
from harness.records.json_record import Record, finite_or_none, read_record, write_record
from harness.records.verdict import Verdict
from scenes.files.errors import DamagedRecord
from scenes.files.json_object import JsonObject

SCHEMA = 2
SHELVES = {name: f"{name}.json" for name in ("evidence", "stability", "speed", "serving", "frontier", "history")}
"""Shelf → its file under OUT."""

CHAPTERS: dict[int, str] = {
    1: "Rounding: error against optical depth",
    2: "Truncation: error against samples",
    3: "Gradients",
    4: "Does a picture depend on how it is cut into calls?",
    5: "Opacity that a scene can reach",
    6: "The amplifier in training",
    7: "Digits lost in half precision",
    8: "Ghosts of an encoding",
    9: "Ladders: where each method breaks",
    10: "Stiff and extreme scenes",
    11: "Spikes, and coming back from them",
    12: "An independent reference",
    13: "What scenes do not need",
}
"""The number in `item` of a stability finding → the title of its chapter."""

Owner = Literal["ours", "paper", "usual", "machine"]
"""The owner of a check: this harness, the paper's form as printed, the usual form in the field's code, or the machine
that was measured. Only a failed check of the harness fails a run; the others are shown as properties.
"""
Status = Literal["pass", "fail", "measured", "inconclusive", "not_applicable", "not_available"]
"""`measured` is the status of a figure without a limit."""
Values = Sequence[float | None]
"""Figures of a line; `None` is a figure that was not finite, which a chart marks as a gap."""


class Answer(Record, frozen=True, tag="answer"):
    """A sentence made of figures."""

    text: str


class Check(Record, frozen=True, tag="check"):
    """A figure and whether it is within its limits."""

    what: str
    """The short name of the figure: `largest relative error of colour`."""
    value: float | None
    """The worst or the median measurement; None without a measurement, for the reason `why`."""
    low: float | None = None
    high: float | None = None
    unit: str = ""
    """The unit; `×` for a ratio, `%` for a share."""
    why: str = ""
    """How it was measured, what a reader must know, or why there is no figure."""
    subject: str = ""
    """The method, quadrature rule, encoding, amplifier or `harness`; empty if the study has one subject."""
    owner: Owner = "ours"
    status: Status = "measured"
    spread: tuple[float, float] | None = None
    """The smallest and the largest repetition."""
    repeats: int = 1
    id: str = ""
    """A stable dotted name by which others refer to this figure: `training.dense.ratio`."""

    @property
    def holds(self) -> bool:
        return self.status in ("pass", "measured")

    @property
    def must_hold(self) -> bool:
        return self.owner == "ours"

    @property
    def is_broken(self) -> bool:
        return self.must_hold and self.status == "fail"

    @property
    def limit(self) -> float | None:
        """Return the only limit, or the nearer of two."""
        limits = [end for end in (self.low, self.high) if end is not None]
        return min(limits, key=lambda end: abs(end - (self.value or 0.0)), default=None)


class Effect(Record, frozen=True, tag="effect"):
    """A difference with its interval: between two methods, or the effect of a part or of an interaction of parts.

    The fields that `harness.records.cells.Comparison` and `Estimate` have too mean the same.
    """

    name: str
    """The part that is added, changed or removed; a method's name if two methods are compared."""
    against: str
    """A method's name; empty for a main effect or an interaction, which is compared with its absence."""
    scene: str
    """A scene's name, or `all`."""
    metric: str
    budget: Budget
    difference: float | None
    interval: tuple[float, float] | None
    simultaneous: tuple[float, float] | None
    family: int
    verdict: Verdict
    smallest_detectable: float | None
    pairs: int
    unpaired: int
    note: str = ""
    on_these_scenes: Estimate | None = None
    """The estimate whose error comes from seeds only, if `interval` is for scenes like these."""
    p: float | None = None


class Series(Record, frozen=True, tag="series"):
    """One line of a chart; lines with the same `panel` share their axes."""

    panel: str
    item: int
    """The number of its chapter, or 0."""
    name: str
    x_label: str
    y_label: str
    x: list[float]
    y: Values
    low: Values | None = None
    high: Values | None = None
    log_x: bool = True
    log_y: bool = True


class Table(Record, frozen=True, tag="table"):
    """Rows of figures and text, for instance of where the remaining time goes."""

    id: str
    item: int
    title: str
    columns: list[str]
    rows: list[list[str | float | None]]


Finding = Answer | Check | Effect | Series | Table


class StudyInfo(Record, frozen=True):
    id: str
    title: str
    question: str = ""
    """A sentence that ends with a question mark."""
    method: str = ""
    """How it is answered, in two or three sentences; `StudyRecord.scale` has scenes, steps and seeds."""
    facts: dict[str, str] = field(default_factory=dict)
    """Further text of the report by title: `input`, `danger`, `reference`, `bar` of a stiff case."""


class StudyRecord(Record, frozen=True):
    """One study and its findings, in the order in which they were made."""

    info: StudyInfo
    scale: str = ""
    """The scenes, seeds, steps and pixels, in one line."""
    findings: list[Finding] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def failed(self) -> bool:
        """Return whether it could not be measured, so that it has to be measured again."""
        return any(check.id == "failed" for check in self.checks)

    @property
    def answers(self) -> list[str]:
        return [finding.text for finding in self.findings if isinstance(finding, Answer)]

    @property
    def checks(self) -> list[Check]:
        return [finding for finding in self.findings if isinstance(finding, Check)]

    @property
    def effects(self) -> list[Effect]:
        return [finding for finding in self.findings if isinstance(finding, Effect)]

    @property
    def series(self) -> list[Series]:
        return [finding for finding in self.findings if isinstance(finding, Series)]

    @property
    def tables(self) -> list[Table]:
        return [finding for finding in self.findings if isinstance(finding, Table)]


class Studies(Record, frozen=True):
    """The complete studies of one shelf, in the order of its catalogue."""

    shelf: str
    provenance: JsonObject
    settings: JsonObject
    studies: list[StudyRecord] = field(default_factory=list)
    finished: bool = False
    schema: int = SCHEMA

    def study(self, name: str) -> StudyRecord | None:
        return next((study for study in self.studies if study.info.id == name), None)

    def checks(self) -> Iterator[tuple[StudyRecord, Check]]:
        return ((study, check) for study in self.studies for check in study.checks)

    @property
    def broken(self) -> list[tuple[StudyRecord, Check]]:
        return [(study, check) for study, check in self.checks() if check.is_broken]

    @property
    def is_complete(self) -> bool:
        """Return whether every planned measurement was made."""
        return self.finished and not any(study.failed for study in self.studies)

    @property
    def is_quick(self) -> bool:
        """Return whether it was measured at sizes that are too small for meaningful figures."""
        return bool(self.settings.get("quick"))


class CheckFacts(TypedDict, total=False):
    """The fields of a `Check` beyond its figure, unit and limits."""

    subject: str
    owner: Owner
    spread: tuple[float, float] | None
    repeats: int
    id: str


def check(
    what: str,
    value: float | None,
    low: float | None = None,
    high: float | None = None,
    unit: str = "",
    why: str = "",
    **facts: Unpack[CheckFacts],
) -> Check:
    """Check `value` against its limits; a missing or non-finite value always fails."""
    if value is not None and not math.isfinite(value):
        value, why = None, f"the figure is {value}" + (f"; {why}" if why else "")
    if value is None:
        status: Status = "fail"
    elif low is None and high is None:
        status = "measured"
    else:
        status = "pass" if (low is None or value >= low) and (high is None or value <= high) else "fail"
    return Check(what, value, low, high, unit, why, status=status, **facts)


def write_studies(path: Path, record: Studies) -> None:
    """Write studies. Non-finite figures become gaps in lines and text in tables; elsewhere they raise `ValueError`."""
    data = msgspec.to_builtins(record)
    for finding in (finding for study in data["studies"] for finding in study["findings"]):
        if finding["type"] == "series":
            for name in ("y", "low", "high"):
                finding[name] = None if finding[name] is None else [finite_or_none(value) for value in finding[name]]
        elif finding["type"] == "table":
            finding["rows"] = [[_finite_or_text(value) for value in row] for row in finding["rows"]]
    write_record(path, data)


def _finite_or_text(value: str | float | None) -> str | float | None:
    return f"not finite ({value})" if isinstance(value, float) and not math.isfinite(value) else value


def again(shelf: str, out: Path) -> str:
    """Return the command that measures a shelf again."""
    own = {"serving": f"python -m harness study serving {out}", "history": "python -m harness history"}
    return f"run `{own.get(shelf, f'nox -s {shelf}')}` again"


def read_studies(path: Path) -> Studies:
    """Read studies; raises `DamagedRecord` for any other file."""
    if not path.exists():
        raise DamagedRecord(f"{path}: is missing; name a file that `nox -s {path.stem}` wrote")
    remedy = again(path.stem, path.parent)
    return read_record(path, Studies, SCHEMA, remedy=remedy, by_hand=True, former=in_two_words)
