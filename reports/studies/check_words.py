"""A check as text: its tone, its figure, its limits, its outcome; and checks as the rows of a table."""

import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

from harness.records.study import Check, StudyRecord
from reports.data.wording import NARROW, after, bare, counted, number, of_any_size, significant
from reports.page import shell
from reports.page.grid import EMPTY, Column, Entry, Grid, without_empty_columns

Tone = Literal["fails", "missed", "property", "passes", "measured", "unsettled", "absent", "spared"]


class Look(NamedTuple):
    mark: str
    word: str
    short: str
    meaning: str


LOOKS: dict[Tone, Look] = {
    "fails": Look("✕", "fails", "fails", "fails, and must pass: it tests our own form"),
    "missed": Look("✕", "missed", "missed", "misses its target"),
    "property": Look(
        "◆",
        "fails: a property of that form",
        "fails",
        "fails, and tests the paper’s printed form or the field’s usual form",
    ),
    "passes": Look("✓", "passes", "pass", "passes"),
    "measured": Look("•", "measured", "measured", "measured; it has no limit"),
    "unsettled": Look("?", "inconclusive", "inconclusive", "inconclusive"),
    "absent": Look("○", "not available", "not here", "not available here"),
    "spared": Look("·", "not applicable", "n/a", "not applicable"),
}
"""Tone → its look. A cell of the matrix with several outcomes shows the first tone of this order."""
OWNERS = {"ours": "ours", "paper": "the paper’s form as printed", "usual": "the field’s usual form"}
COLUMNS = ("study", "subject", "figure", "measured", "wanted", "outcome")
SCALES = {"ms": 1e-3, "min": 60.0, "h": 3600.0, "kB": 1e3, "MB": 1e6, "GB": 1e9}
"""Unit → seconds or bytes, for sorting a column whose figures have different units."""
SMALL_FACTOR = 2.0
"""The largest factor that is shown as a percentage."""


def tone_of(check: Check) -> Tone:
    if check.status == "fail":
        if check.owner == "machine":
            return "absent" if check.limit is None else "missed"
        return "fails" if check.must_hold else "property"
    tones: dict[str, Tone] = {
        "pass": "passes",
        "measured": "measured",
        "inconclusive": "unsettled",
        "not_available": "absent",
        "not_applicable": "spared",
    }
    return tones[check.status]


def figure_of(check: Check, digits: int = 3) -> str:
    """Return the figure with its unit; a failing figure has enough digits to differ from its limits."""
    if check.value is None:
        return ""
    limits = [limit for limit in (check.low, check.high) if limit is not None and check.status == "fail"]
    enough = (
        more
        for more in range(digits, 16)
        if all(of_any_size(check.value, more) != of_any_size(limit, more) for limit in limits)
    )
    return f"{of_any_size(check.value, next(enough, 16))}{after(check.unit)}"


def limits_of(check: Check) -> str:
    """Return the limits as `≤ 0.05` or `0.8 … 1`; empty if there are none."""
    low, high = (None if limit is None else bare(limit) for limit in (check.low, check.high))
    if low and high:
        return f"{low} … {high}{after(check.unit)}"
    return f"≥ {low}{after(check.unit)}" if low else f"≤ {high}{after(check.unit)}" if high else ""


def spread_of(check: Check) -> str:
    """Return the range of the repetitions, `7.11–7.63×`, or `measured once`; empty for what is not a measurement."""
    if check.value is None or check.owner != "machine":
        return ""
    if check.spread is None or (check.repeats < 2 and check.spread[0] == check.spread[1]):
        return "measured once" if check.repeats == 1 else counted(check.repeats, "repetition")
    low, high = map(of_any_size, check.spread)
    times = f", {counted(check.repeats, 'repetition')}" if check.repeats > 1 else ""
    return f"{low}{' to ' if min(check.spread) < 0 else '–'}{high}{after(check.unit)}{times}"


def outcome(check: Check) -> str:
    """Return `✓ passes`, `✕ missed by 6.9 points`, …"""
    look, limit = LOOKS[tone_of(check)], check.limit
    if check.owner != "machine" or limit is None or check.status == "inconclusive":
        return f"{look.mark} {look.word}"
    if check.value is None:
        return f"{look.mark} not met, as it has no figure"
    far = distance(check.value, limit, check.unit)
    if check.holds:
        return f"{look.mark} met" + (f", {far} {'above' if check.value > limit else 'below'}" if far else "")
    return f"{look.mark} missed" + (f" by {far}" if far else "")


def distance(value: float, limit: float, unit: str) -> str:
    """Return `6.9 points`, `12 %` or `a factor of 2.1`; empty for the target itself or the other side of 0."""
    small, large = sorted((value, limit))
    if small == large or (unit != "%" and (small <= 0 or not math.isfinite(large / small))):
        return ""
    if unit == "%":
        return f"{_two_digits(large - small)} points"
    if large / small > SMALL_FACTOR:
        return f"a factor of {significant(large / small, 2)}"
    return f"{_two_digits(100 * (large - small) / limit)}{NARROW}%"


def _two_digits(value: float) -> str:
    return significant(value, 2) if value < 10 else number(value, 0)


def repetitions(check: Check) -> str:
    """State whether single repetitions meet the target although the median does not, or the reverse."""
    if check.limit is None or check.value is None or check.spread is None:
        return ""
    met, *meets = [
        edge >= check.limit if check.high is None else edge <= check.limit for edge in (check.value, *check.spread)
    ]
    if met:
        return "" if all(meets) else "not in every repetition"
    return "reached in the best repetition" if any(meets) else ""


def describe(check: Check) -> str:
    """Return a line such as `midpoint: largest relative error: 0.02, wanted ≤ 10⁻⁶ (over 1000 rays)`."""
    figures = ", wanted ".join(filter(None, (figure_of(check) or "no figure", limits_of(check))))
    words = ": ".join(filter(None, (check.subject, check.what, "" if check.value is None and check.holds else figures)))
    return f"{words} ({check.why})" if check.why else words


def short_figure(check: Check) -> str:
    """Return the text of a narrow cell: the figure, or a word if there is none."""
    not_finite = "not finite" if check.status == "fail" and check.why.startswith("the figure is ") else ""
    return figure_of(check, 2) or not_finite or LOOKS[tone_of(check)].short


def checks_grid(
    title: str, rows: Sequence[tuple[StudyRecord, Check]], name_of: Callable[[StudyRecord], str] | None = None
) -> Grid:
    """Tabulate checks, the broken first; with `name_of` each row names and links its study, which gives the reasons."""
    subjects = any(check.subject for _, check in rows)
    judged = subjects or any(check.limit is not None for _, check in rows)
    columns = [Column(label, numeric=label in ("measured", "wanted")) for label in COLUMNS]
    lines = [
        [
            Entry(name_of(study), link=anchor(study)) if name_of else EMPTY,
            Entry(check.subject, OWNERS.get(check.owner, "")) if subjects else EMPTY,
            Entry(check.what or check.why, check.why if check.what and not name_of else ""),
            _measured(check),
            Entry(limits_of(check), tone="muted") if check.limit is not None else EMPTY,
            Entry(outcome(check), repetitions(check), tone_of(check)) if judged else EMPTY,
        ]
        for study, check in sorted(rows, key=lambda row: not row[1].is_broken)
    ]
    return without_empty_columns(Grid(title, columns, lines))


def _measured(check: Check) -> Entry:
    if check.value is None:
        return EMPTY
    ends = zip(("low", "high"), check.spread or (), strict=False)
    value = check.value * SCALES.get(check.unit, 1.0)
    return Entry(figure_of(check), spread_of(check), value=value, parts=dict(ends))


def anchor(study: StudyRecord) -> str:
    return shell.anchor("study", study.info.id)
