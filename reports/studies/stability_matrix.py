"""Outcomes of stability cases in words, and the matrix case × subject.

There is one table for each group of cases with the subjects that recur in it. A subject of a single case would be a
column of one cell: it stands below the row of its case instead.
"""

from dataclasses import dataclass
from typing import Literal

from harness.records.study import Check, Studies, StudyRecord
from reports.data.wording import MINUS, RAISED, after, counted, listed, of_any_size
from reports.page import shell

Tone = Literal["passes", "fails", "property", "unsettled", "absent", "spared"]
"""The tone of an outcome; `property`: a formula that is not ours fails, which is what it was tried for."""

MARKS: dict[Tone, str] = {"fails": "✕", "property": "◆", "passes": "✓", "unsettled": "?", "absent": "○", "spared": "·"}
"""The mark of each tone, the gravest first."""

WHOSE = {"ours": "ours", "paper": "paper", "usual": "usual"}
OWNERS = {"ours": "ours", "paper": "the paper’s form as printed", "usual": "the field’s usual form"}

LEGEND: tuple[tuple[Tone, str], ...] = (
    ("passes", "passes"),
    ("fails", "fails, and is ours: it must pass"),
    ("property", "fails, and is the paper’s printed form or the field’s usual one: a property of theirs"),
    ("unsettled", "inconclusive"),
    ("absent", "not available here"),
    ("spared", "not applicable"),
)


def tone_of(one: Check) -> Tone:
    if one.status == "inconclusive":
        return "unsettled"
    if one.status == "not_available":
        return "absent"
    if one.status == "not_applicable":
        return "spared"
    if one.status == "pass":
        return "passes"
    return "fails" if one.must_hold else "property"


def verdict(one: Check) -> str:
    """Return `passes`, `fails`, `fails: a property of the paper’s form as printed`, …"""
    tone = tone_of(one)
    if tone == "property":
        return f"fails: a property of {OWNERS[one.owner]}"
    words = {"unsettled": "inconclusive", "absent": "not available", "spared": "not applicable"}
    return words.get(tone, tone)


def written(one: Check, digits: int = 3) -> str:
    """Return the figure with its unit, or nothing; with as many digits as it takes to distinguish a failing one from
    its bar.
    """
    if one.value is None:
        return ""
    if one.status == "fail" and one.limit is not None:
        figure, bar = one.value, one.limit
        apart = (more for more in range(digits, 16) if of_any_size(figure, more) != of_any_size(bar, more))
        digits = next(apart, digits)
    return f"{of_any_size(one.value, digits)}{after(one.unit)}"


def wanted(one: Check) -> str:
    """Return the bar as `≤ 10⁻⁶`, or nothing."""
    if one.limit is None:
        return ""
    return f"{'≤' if one.low is None else '≥'} {round_figure(one.limit)}{after(one.unit)}"


def round_figure(value: float) -> str:
    """Return a bar without superfluous digits: 2·10⁻⁶, 0.15, 200."""
    mantissa, _, exponent = f"{value:.4g}".partition("e")
    if not exponent and value != 0 and abs(value) < 1e-2:
        mantissa, _, exponent = f"{value:.3e}".partition("e")
        mantissa = f"{float(mantissa):g}"
    if not exponent:
        return mantissa.replace("-", MINUS)
    power = f"10{str(int(exponent)).translate(RAISED)}"
    return power if float(mantissa) == 1 else f"{mantissa}·{power}".replace("-", MINUS)


def strain(one: Check) -> float:
    """Return how near it is to its bar or how far beyond it: 1 at the bar, more if it fails; to find the worst of
    several.
    """
    if one.value is None or one.limit is None:
        return float("inf") if one.status == "fail" else 0.0
    large, small = (one.value, one.limit) if one.low is None else (one.limit, one.value)
    return large / small if small > 0 else float(large > small)


def told(one: Check) -> str:
    """Return all facts of an outcome in one line, shown when a reader points at a cell."""
    figures = " ".join(filter(None, (written(one), f"(wanted {wanted(one)})" if one.limit is not None else "")))
    said = "; ".join(filter(None, (one.what, one.why)))
    return f"{one.subject} ({OWNERS[one.owner]}): " + ", ".join(filter(None, (verdict(one), figures, said)))


def headline(record: Studies) -> str:
    """Return the main message of the page: ours first."""
    ours = [one for _, one in record.checks() if one.must_hold and one.status in ("pass", "fail")]
    lost = record.broken
    if not ours:
        return "Numerical stability: nothing of this harness was tried"
    if lost:
        return f"{len(lost)} of {counted(len(ours), 'stability check')} of this harness " + (
            "fails" if len(lost) == 1 else "fail"
        )
    every = f"All {len(ours)} stability checks" if len(ours) > 1 else "The one stability check"
    return f"{every} of this harness {'pass' if len(ours) > 1 else 'passes'}"


def sentences(record: Studies) -> list[str]:
    """Return how much was tried, what of ours failed, what was found of the others, what could not be tried."""
    outcomes = [one for _, one in record.checks()]
    if not outcomes:
        return [f"{counted(len(record.studies), 'case')} tried, without an outcome."]
    subjects = {one.subject for one in outcomes}
    found = [
        f"{counted(len(record.studies), 'case')} on {counted(len(subjects), 'subject')} (methods, formulas and the "
        f"harness as a whole): {counted(len(outcomes), 'outcome')}."
    ]
    ours = [one for one in outcomes if one.must_hold and one.status in ("pass", "fail")]
    lost = record.broken
    names = listed(
        [f"{case.info.id} {one.subject}" for case, one in lost[:4]] + ([f"{len(lost) - 4} more"] if lost[4:] else [])
    )
    found.append(
        f"Of the {counted(len(ours), 'check')} on what is ours, {len(lost)} {'fails' if len(lost) == 1 else 'fail'}: "
        f"{names}."
        if lost
        else f"Everything that is ours passes: {counted(len(ours), 'check')}."
        if ours
        else "Nothing of ours was put to the test."
    )
    if open_ := sum(one.status == "inconclusive" for one in outcomes):
        found.append(f"Inconclusive: {counted(open_, 'check')}; each says why.")
    found.append(_others(outcomes))
    aside = [
        f"{many} {words}"
        for status, words in (("not_available", "not available here"), ("not_applicable", "not applicable"))
        if (many := sum(one.status == status for one in outcomes))
    ]
    return [*found, *([f"Not tried: {listed(aside)}; each says why."] if aside else [])]


def _others(outcomes: list[Check]) -> str:
    """Return what was found of the forms that are not ours."""
    parts = []
    for whose, words in (("paper", "the paper’s forms as printed"), ("usual", "the field’s usual forms")):
        tried = [one for one in outcomes if one.owner == whose and one.status in ("pass", "fail")]
        if tried:
            parts.append(f"{words} miss the bar in {sum(one.status == 'fail' for one in tried)} of {len(tried)} checks")
    if not parts:
        return "No form of the paper or of the field’s usual code was tried beside them."
    return f"{listed(parts)[0].upper()}{listed(parts)[1:]}; these are properties of theirs, not failures."


def shown(one: Check, digits: int = 2) -> str:
    """Return the text of a cell of the matrix: the figure, else a word."""
    words = {"passes": "pass", "unsettled": "inconclusive", "absent": "not here", "spared": "n/a"}
    lost = "not finite" if one.status == "fail" and one.why.startswith("the figure is ") else ""
    return written(one, digits) or lost or words.get(tone_of(one), "fails")


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
"""The largest number of columns of subjects that a reader can still compare."""
ROW_ALONE = 6
"""The number of subjects up to which a group of one case has columns too."""


@dataclass(frozen=True)
class Cell:
    """The outcome of one case on one subject, the gravest of what was measured."""

    subject: str
    tone: Tone
    mark: str
    text: str
    small: str
    """`worst of 3`, if there are several."""
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
    """One cell per column; None if the case was not tried on it."""
    others: list[Cell]
    """The subjects without a column."""


@dataclass(frozen=True)
class Group:
    title: str
    subjects: list[tuple[str, str]]
    """The column and whose form it is."""
    rows: list[Row]


def groups(record: Studies) -> list[Group]:
    """Group by the letter of the case, in the order of the record; a case without an outcome has an empty row."""
    letters = dict.fromkeys(letter(case) for case in record.studies)
    return [_group(one, [case for case in record.studies if letter(case) == one]) for one in letters]


def letter(case: StudyRecord) -> str:
    return case.info.id[:1]


def anchor(case: StudyRecord) -> str:
    """Return the id of its details in the page."""
    return shell.anchor("case", case.info.id)


def _group(name: str, cases: list[StudyRecord]) -> Group:
    columns = _columns(cases)
    rows = [_row(case, columns) for case in cases]
    every = [one for case in cases for one in case.checks]
    owners = {
        subject: ", ".join(dict.fromkeys(WHOSE[one.owner] for one in every if one.subject == subject))
        for subject in columns
    }
    return Group(GROUPS.get(name, f"Cases {name}"), list(owners.items()), rows)


def _columns(cases: list[StudyRecord]) -> list[str]:
    """Return the subjects of at least two cases, the most frequent if there are too many; what is ours first."""
    many = {
        subject: sum(any(one.subject == subject for one in case.checks) for case in cases)
        for subject in dict.fromkeys(one.subject for case in cases for one in case.checks)
    }
    recurring = [subject for subject in many if many[subject] > 1]
    if len(cases) == 1 and len(many) <= ROW_ALONE:
        recurring = list(many)
    kept = sorted(recurring, key=lambda subject: -many[subject])[:WIDEST]
    owner = {one.subject: list(WHOSE).index(one.owner) for case in cases for one in case.checks}
    return sorted(kept, key=lambda subject: (owner[subject], list(many).index(subject)))


def _row(case: StudyRecord, columns: list[str]) -> Row:
    by_subject: dict[str, list[Check]] = {}
    for one in case.checks:
        by_subject.setdefault(one.subject, []).append(one)
    cells = {subject: cell(found) for subject, found in by_subject.items()}
    return Row(
        case.info.id,
        anchor(case),
        case.info.title,
        case.info.facts.get("bar", ""),
        any(one.is_broken for one in case.checks),
        [cells.get(subject) for subject in columns],
        [one for subject, one in cells.items() if subject not in columns],
    )


def cell(found: list[Check]) -> Cell:
    """Return one cell for any number of outcomes: the gravest, of equally grave ones that nearest to or furthest beyond
    its bar.

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
