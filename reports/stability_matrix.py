"""Outcomes → the matrix case × subject, a table for each group of cases with the subjects that recur in it.

A subject of a single case would be a column of one cell: it stands below the row of its case instead.
"""

import re
from dataclasses import dataclass

from harness.stability_record import CaseRecord, Outcome, StabilityRecord
from reports.stability_wording import MARKS, WHOSE, Tone, shown, strain, told, tone_of

GROUPS = {
    "Q": "Quadrature and sampling",
    "E": "Encodings",
    "A": "The amplifier",
    "O": "Optimiser and half precision",
    "S": "Stiff and extreme scenes",
    "C": "Cameras and sizes",
    "R": "An independent reference",
    "L": "Ladders",
    "N": "What a scene does not need",
}
WIDEST = 9
"""Columns of subjects that a reader can still compare."""
ROW_ALONE = 6
"""Up to so many subjects a group of one case has columns too."""


@dataclass(frozen=True)
class Cell:
    """What became of one case on one subject, the gravest of what was measured."""

    subject: str
    tone: Tone
    mark: str
    text: str
    small: str
    """`worst of 3`, where there are several."""
    title: str
    """Every outcome in full."""


@dataclass(frozen=True)
class Row:
    case: str
    anchor: str
    title: str
    bar: str
    failed: bool
    cells: list[Cell | None]
    """A cell a column; None where the case was not tried on it."""
    others: list[Cell]
    """Subjects without a column."""


@dataclass(frozen=True)
class Group:
    title: str
    subjects: list[tuple[str, str]]
    """Column and whose form it is."""
    rows: list[Row]


def groups(record: StabilityRecord) -> list[Group]:
    """By the letter of the case, in the order of the record; a case without an outcome has an empty row."""
    letters = dict.fromkeys(letter(case) for case in record.cases)
    return [_group(one, [case for case in record.cases if letter(case) == one]) for one in letters]


def letter(case: CaseRecord) -> str:
    return case.info.id[:1]


def anchor(case: CaseRecord) -> str:
    """The id of its details in the page: readable where the case's own id is a plain word."""
    name = case.info.id
    return f"case-{name if re.fullmatch('[A-Za-z0-9]+', name) else '-' + name.encode().hex()}"


def _group(name: str, cases: list[CaseRecord]) -> Group:
    columns = _columns(cases)
    rows = [_row(case, columns) for case in cases]
    every = [one for case in cases for one in case.outcomes]
    owners = {
        subject: ", ".join(dict.fromkeys(WHOSE[one.whose] for one in every if one.subject == subject))
        for subject in columns
    }
    return Group(GROUPS.get(name, f"Cases {name}"), list(owners.items()), rows)


def _columns(cases: list[CaseRecord]) -> list[str]:
    """Subjects of at least two cases, the most frequent where there are too many; what is ours first."""
    many = {
        subject: sum(any(one.subject == subject for one in case.outcomes) for case in cases)
        for subject in dict.fromkeys(one.subject for case in cases for one in case.outcomes)
    }
    recurring = [subject for subject in many if many[subject] > 1]
    if len(cases) == 1 and len(many) <= ROW_ALONE:
        recurring = list(many)
    kept = sorted(recurring, key=lambda subject: -many[subject])[:WIDEST]
    owner = {one.subject: list(WHOSE).index(one.whose) for case in cases for one in case.outcomes}
    return sorted(kept, key=lambda subject: (owner[subject], list(many).index(subject)))


def _row(case: CaseRecord, columns: list[str]) -> Row:
    by_subject: dict[str, list[Outcome]] = {}
    for one in case.outcomes:
        by_subject.setdefault(one.subject, []).append(one)
    cells = {subject: cell(found) for subject, found in by_subject.items()}
    return Row(
        case.info.id,
        anchor(case),
        case.info.title,
        case.info.bar,
        any(one.broke for one in case.outcomes),
        [cells.get(subject) for subject in columns],
        [one for subject, one in cells.items() if subject not in columns],
    )


def cell(found: list[Outcome]) -> Cell:
    """One cell of however many outcomes: the gravest, of equally grave ones that nearest to or furthest beyond its bar.

    `found` is not empty.
    """
    order = list(MARKS)
    worst = min(found, key=lambda one: (order.index(tone_of(one)), -strain(one)))
    tone = tone_of(worst)
    alike = sum(tone_of(one) == tone for one in found)
    small = ""
    if len(found) > 1:
        small = f"worst of {len(found)}" if alike == len(found) else f"{alike} of {len(found)}"
    return Cell(worst.subject, tone, MARKS[tone], shown(worst), small, "\n".join(map(told, found)))
