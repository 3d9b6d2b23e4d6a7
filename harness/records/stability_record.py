"""What `nox -s stability` leaves behind: `stability.json`, every case of the catalogue on everything it applies to.

This module imports the standard library, `harness.records.cells` and `harness.records.charts` alone, as reports read
it.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

from harness.records.charts import Series, Table, with_gaps
from harness.records.json_record import DamagedRecord, load_record, sound, write_record

STABILITY_SCHEMA = 1
STABILITY_FILE = "stability.json"
PICTURES_FOLDER = "stability"

Status = Literal["pass", "fail", "inconclusive", "not_applicable", "not_available"]
Whose = Literal["ours", "paper", "usual"]
"""Whose formula was put to the test: this harness's own, the paper's as printed, or what the field's code usually has.
Only what is ours must pass; what the others do is shown as a property of theirs."""


@dataclass(frozen=True)
class Outcome:
    """One case on one subject: a method, a rule, or the harness as a whole."""

    case: str
    """Id in the catalogue, `Q1`."""
    subject: str
    """Method, quadrature rule, encoding, amplifier, or `harness`: a row of the matrix."""
    whose: Whose
    status: Status
    figure: float | None = None
    """The worst of what was measured; None where nothing was, or where it was not finite: `why` says so."""
    bar: float | None = None
    sense: Literal["at_most", "at_least"] = "at_most"
    unit: str = ""
    what: str = ""
    """What the figure is, in a few words: `largest relative error of colour`."""
    why: str = ""
    """Why it is not applicable or not available; what happened where there is no figure; else what a reader must know.
    """

    @property
    def must_pass(self) -> bool:
        return self.whose == "ours"

    @property
    def broke(self) -> bool:
        """Whether this outcome fails the run."""
        return self.must_pass and self.status == "fail"


def judged(
    case: str,
    subject: str,
    whose: Whose,
    figure: float,
    bar: float,
    *,
    what: str,
    unit: str = "",
    sense: Literal["at_most", "at_least"] = "at_most",
    why: str = "",
) -> Outcome:
    """`figure` against `bar`; a figure that is not finite fails, whatever the bar."""
    finite = figure == figure and abs(figure) != float("inf")
    holds = finite and (figure <= bar if sense == "at_most" else figure >= bar)
    if not finite:
        why = f"the figure is {figure}" + (f"; {why}" if why else "")
    return Outcome(
        case, subject, whose, "pass" if holds else "fail", figure if finite else None, bar, sense, unit, what, why
    )


@dataclass(frozen=True)
class CaseInfo:
    """A case as the report shows it."""

    id: str
    title: str
    input: str
    """What is put in."""
    danger: str
    """What goes wrong in the paper's form or in the field's usual code."""
    reference: str
    """What the truth is taken from."""
    bar: str
    """What counts as passed, and `measured` where the bar was set from a measurement of ours."""


@dataclass(frozen=True)
class Picture:
    """An image beside the record."""

    item: int
    title: str
    caption: str
    path: str
    """Of a PNG, relative to the output folder."""


CHAPTERS: dict[int, str] = {
    1: "Rounding: error against optical depth",
    2: "Truncation: error against samples and time",
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
"""Number → title of what `Series.item`, `Table.item` and `Picture.item` belong to."""


@dataclass(frozen=True)
class CaseRecord:
    """A case and everything that came of it."""

    info: CaseInfo
    outcomes: list[Outcome] = field(default_factory=list)
    series: list[Series] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    pictures: list[Picture] = field(default_factory=list)
    seconds: float = 0.0


@dataclass(frozen=True)
class StabilityRecord:
    """One run of `nox -s stability`: the cases that are whole, in the order of the catalogue."""

    provenance: dict[str, Any]
    settings: dict[str, Any]
    cases: list[CaseRecord] = field(default_factory=list)
    finished: bool = False
    schema: int = STABILITY_SCHEMA

    def outcomes(self) -> Iterator[Outcome]:
        return (outcome for case in self.cases for outcome in case.outcomes)


def broken(record: StabilityRecord) -> list[Outcome]:
    """What must pass and did not."""
    return [one for one in record.outcomes() if one.broke]


def write_stability(path: Path, record: StabilityRecord) -> None:
    """`record` as JSON. A point of a line that is not finite is kept as a gap, a table's as words; raises `ValueError`
    where a figure of an outcome, or an x, is not finite."""
    data = asdict(record)
    for case in data["cases"]:
        with_gaps(case)
    write_record(path, data)


def read_stability(path: Path) -> StabilityRecord:
    """Raises `DamagedRecord` where the file is not what this version writes."""
    try:
        data = load_record(path)
        if data.get("schema") != STABILITY_SCHEMA or set(data) != {one.name for one in fields(StabilityRecord)}:
            raise ValueError(f"not a stability record of schema {STABILITY_SCHEMA}")
        return sound(StabilityRecord(**{**data, "cases": [_case(row) for row in data["cases"]]}), StabilityRecord)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, IndexError) as error:
        raise DamagedRecord(f"{path}: {error}; run `nox -s stability` again") from error


def _case(row: dict[str, Any]) -> CaseRecord:
    return CaseRecord(
        **{
            **row,
            "info": CaseInfo(**row["info"]),
            "outcomes": [Outcome(**one) for one in row["outcomes"]],
            "series": [Series(**one) for one in row["series"]],
            "tables": [Table(**one) for one in row["tables"]],
            "pictures": [Picture(**one) for one in row["pictures"]],
        }
    )
