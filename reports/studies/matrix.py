"""Checks → the matrix study × subject, in full, as marks only, and in miniature for a README.

Each group of studies has a table with a column for each subject of several studies. The subject of a single study would
be a column of one cell: it is shown below the row of its study instead.
"""

from typing import NamedTuple

from harness.records.study import Check, Studies, StudyRecord
from reports.drawing.palette import KNOWN, MUTED, OTHERS, Pen
from reports.drawing.traces import Panel, Trace
from reports.studies.check_words import LOOKS, OWNERS, Tone, anchor, describe, outcome, short_figure, tone_of
from reports.studies.shelves import WORDS

WIDEST = 9
"""The largest number of columns of subjects that a reader can still compare."""
ROW_ALONE = 6
"""The number of subjects up to which a group of one study has columns too."""
PENS: dict[Tone, Pen] = {
    "fails": Pen(OTHERS[3], "^", False, ()),
    "missed": Pen(OTHERS[3], "^", False, ()),
    "property": Pen(KNOWN["qnerf_theorem"], "D", False, ()),
    "passes": Pen(OTHERS[0], "o", False, ()),
    "measured": Pen(MUTED, "s", True, ()),
    "unsettled": Pen(MUTED, "o", True, ()),
    "absent": Pen(MUTED, "^", True, ()),
    "spared": Pen(MUTED, "D", True, ()),
}
LEAST_COLUMNS = 12
"""The minimum width of the marks of one owner, whose name is above them."""


class Cell(NamedTuple):
    subject: str
    tone: Tone
    mark: str
    text: str
    small: str
    """`worst of 3`, if there are several."""
    title: str
    """Every outcome in full."""


class Row(NamedTuple):
    study: StudyRecord
    anchor: str
    failed: bool
    cells: list[Cell | None]
    """One cell per column; None if the study was not tried on it."""
    others: list[Cell]
    """The subjects without a column."""


class Glance(NamedTuple):
    """A row of the matrix as marks: the cells of each owner in `OWNERS` that has any in this record."""

    study: StudyRecord
    anchor: str
    marks: list[list[Cell]]


class Group(NamedTuple):
    title: str
    subjects: list[tuple[str, str]]
    """The column and whose form it is."""
    rows: list[Row]


def groups(record: Studies) -> list[Group]:
    """Group studies by the first letter of their id, in the order of the record; empty if the shelf has no groups."""
    titles = WORDS[record.shelf].groups
    letters = dict.fromkeys(study.info.id[:1] for study in record.studies if titles)
    return [
        _group(
            titles.get(letter, f"Group {letter}"), [study for study in record.studies if study.info.id[:1] == letter]
        )
        for letter in letters
    ]


def glance(record: Studies) -> tuple[list[str], list[Glance]]:
    """Return the owners of the tested forms, and a row of marks per study with a mark per subject of each owner."""
    tried = {check.owner for _, check in record.checks()}
    owners = [owner for owner in OWNERS if owner in tried]
    rows = [
        Glance(
            study,
            anchor(study),
            [list(cells_of([check for check in study.checks if check.owner == owner]).values()) for owner in owners],
        )
        for study in record.studies
    ]
    return [OWNERS[owner].removeprefix("the ") for owner in owners], rows


def tones_of(group: Group) -> list[Tone]:
    return [cell.tone for row in group.rows for cell in [*row.cells, *row.others] if cell is not None]


def _group(title: str, studies: list[StudyRecord]) -> Group:
    columns = _columns(studies)
    every = [check for study in studies for check in study.checks]
    owners = {
        subject: ", ".join(dict.fromkeys(check.owner for check in every if check.subject == subject))
        for subject in columns
    }
    return Group(title, list(owners.items()), [_row(study, columns) for study in studies])


def _columns(studies: list[StudyRecord]) -> list[str]:
    """Return the subjects of at least two studies, the most frequent if there are too many; our own forms first."""
    owner = {check.subject: list(OWNERS).index(check.owner) for study in studies for check in study.checks}
    many = {
        subject: sum(any(check.subject == subject for check in study.checks) for study in studies) for subject in owner
    }
    recurring = [subject for subject in many if many[subject] > 1]
    if len(studies) == 1 and len(many) <= ROW_ALONE:
        recurring = list(many)
    kept = sorted(recurring, key=lambda subject: -many[subject])[:WIDEST]
    return sorted(kept, key=lambda subject: (owner[subject], list(many).index(subject)))


def _row(study: StudyRecord, columns: list[str]) -> Row:
    cells = cells_of(study.checks)
    return Row(
        study,
        anchor(study),
        any(check.is_broken for check in study.checks),
        [cells.get(subject) for subject in columns],
        [cell for subject, cell in cells.items() if subject not in columns],
    )


def cells_of(checks: list[Check]) -> dict[str, Cell]:
    by_subject: dict[str, list[Check]] = {}
    for check in checks:
        by_subject.setdefault(check.subject, []).append(check)
    return {subject: worst_of(of_subject) for subject, of_subject in by_subject.items()}


def worst_of(checks: list[Check]) -> Cell:
    """Return one cell for one or more outcomes: the worst tone, and in it the figure with the largest `strain`."""
    order = list(LOOKS)
    worst = min(checks, key=lambda check: (order.index(tone_of(check)), -strain(check)))
    tone = tone_of(worst)
    alike = sum(tone_of(check) == tone for check in checks)
    small = (
        "" if len(checks) == 1 else f"worst of {len(checks)}" if alike == len(checks) else f"{alike} of {len(checks)}"
    )
    title = "\n".join(f"{outcome(check)}: {describe(check)}" for check in checks)
    return Cell(worst.subject, tone, LOOKS[tone].mark, short_figure(worst), small, title)


def strain(check: Check) -> float:
    """Return the figure relative to its limit: 1 at the limit, more if the check fails."""
    if check.value is None or check.limit is None:
        return float("inf") if check.status == "fail" else 0.0
    large, small = (check.value, check.limit) if check.low is None else (check.limit, check.value)
    return large / small if small > 0 else float(large > small)


def miniature(record: Studies) -> list[Panel]:
    """Draw the matrix of a shelf that has one as marks: a row per study, columns by the owner of the form."""
    studies = [study for study in record.studies if study.checks and WORDS[record.shelf].groups]
    places: dict[Tone, list[tuple[float, float]]] = {}
    columns = []
    start = 0.0
    for owner, words in OWNERS.items():
        rows = [cells_of([check for check in study.checks if check.owner == owner]) for study in studies]
        widest = max(map(len, rows), default=0)
        if widest:
            columns.append((start, words.removeprefix("the ")))
            for line, cells in enumerate(rows):
                for place, cell in enumerate(cells.values()):
                    places.setdefault(cell.tone, []).append((start + place, float(line)))
            start += max(widest + 1, LEAST_COLUMNS)
    if not studies:
        return []
    traces = []
    for tone, look in LOOKS.items():
        if tone in places:
            x, y = zip(*places[tone], strict=True)
            pen = PENS[tone]
            traces.append(Trace(look.meaning, pen.colour.light, "mark", x, y, marker=pen.marker, hollow=pen.hollow))
    counts = ", ".join(f"{len(places[tone])} × {look.word}" for tone, look in LOOKS.items() if tone in places)
    return [
        Panel(
            "Every case at a glance",
            "",
            "",
            tuple(traces),
            f"Marks of {len(studies)} studies by subject: {counts}.",
            x_limits=(-0.6, start),
            rows=tuple(f"{study.info.id} {study.info.title}" for study in studies),
            columns=tuple(columns),
            size=(2.6 + 0.16 * start, 0.6 + 0.19 * len(studies)),
        )
    ]
