"""A speed record → speed.html: how fast this machine is, in the same design as the report and as self-contained."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from harness.records.speed_record import QUESTIONS, Measurement, SpeedRecord
from reports.data import wording
from reports.data.studies_load import is_quick
from reports.data.wording import NARROW, NOTHING, after, count, counted, figure, number, significant, with_unit
from reports.drawing.series_charts import Chart, charts
from reports.page import shell
from reports.page.grid import EMPTY, Column, Entry, Grid, tables_grids
from reports.page.script import content_policy

SMALL_FACTOR = 2.0
"""Up to here a distance from the target is a percentage, beyond it a factor."""


def spread(one: Measurement) -> str:
    """`7.11–7.63×`, or nothing where it was not repeated."""
    if one.low is None or one.high is None or one.value is None:
        return ""
    if one.repeats < 2 and one.low == one.high:
        return ""
    join = " to " if min(one.low, one.high) < 0 else "–"
    return f"{figure(one.low)}{join}{figure(one.high)}{after(one.unit)}"


def target(one: Measurement) -> str:
    """`≥ 10×`: without digits that nobody asked for."""
    if one.target is None:
        return ""
    short = f"{one.target:.6g}"
    text = count(round(one.target)) if float(short).is_integer() else short if "e" not in short else figure(one.target)
    return f"{'≥' if one.sense == 'at_least' else '≤'} {text}{after(one.unit)}"


def outcome(one: Measurement) -> str:
    """`met, 12 % above`, `missed by 6.9 points`, `no figure, so not met`; nothing without a target."""
    if one.target is None:
        return ""
    if one.value is None:
        return "no figure, so not met"
    if one.value == one.target:
        return "met exactly"
    return _met(one.value, one.target, one) if one.met else f"missed{_shortfall(one.value, one.target, one.unit)}"


def _met(value: float, goal: float, one: Measurement) -> str:
    side = "above" if value > goal else "below"
    if one.unit == "%":
        return f"met, {_points(value - goal)} {side}"
    factor = _factor(value, goal)
    if factor is None:
        return "met"
    if factor > SMALL_FACTOR:
        return f"met, {significant(factor, 2)}× {'the target' if value > goal else 'below it'}"
    return f"met, {_share(value, goal)} {side}"


def _shortfall(value: float, goal: float, unit: str) -> str:
    if unit == "%":
        return f" by {_points(value - goal)}"
    factor = _factor(value, goal)
    if factor is None:
        return ""
    return f" by a factor of {significant(factor, 2)}" if factor > SMALL_FACTOR else f" by {_share(value, goal)}"


def in_repetitions(one: Measurement) -> str:
    """Where the spread straddles the target: the median alone says too little."""
    if one.target is None or one.met is None or one.low is None or one.high is None:
        return ""
    worst, best = (one.low, one.high) if one.sense == "at_least" else (one.high, one.low)
    reached = [(edge >= one.target if one.sense == "at_least" else edge <= one.target) for edge in (worst, best)]
    if one.met and not reached[0]:
        return "not in every repetition"
    if not one.met and reached[1]:
        return "reached in the best repetition"
    return ""


def _factor(value: float, goal: float) -> float | None:
    """How many times the larger is the smaller."""
    small, large = sorted((value, goal))
    return large / small if small > 0 and math.isfinite(large / small) else None


def _share(value: float, goal: float) -> str:
    return f"{_two_digits(100 * abs(value - goal) / goal)}{NARROW}%"


def _points(difference: float) -> str:
    return f"{_two_digits(abs(difference))} points"


def _two_digits(value: float) -> str:
    return significant(value, 2) if value < 10 else number(value, 0)


TONES = {True: "met", False: "missed", None: "unmeasured"}


@dataclass(frozen=True)
class Aim:
    """One target and what became of it."""

    title: str
    item: int
    question: str
    value: str
    spread: str
    target: str
    tone: str
    """`met`, `missed` or `unmeasured`."""
    outcome: str
    small: str


def question(item: int) -> str:
    return QUESTIONS.get(item, f"Question {item}")


def items(record: SpeedRecord) -> list[int]:
    """Questions that have something to show: in their own order, then those that this version does not know."""
    known = list(QUESTIONS)
    found = {one.item for one in record.measurements}
    found |= {one.item for one in record.series if one.x}
    found |= {one.item for one in record.tables if one.rows and one.columns}
    return sorted(found, key=lambda item: (known.index(item) if item in known else len(known), item))


def aims(record: SpeedRecord) -> list[Aim]:
    """Every target, by question."""
    order = items(record)
    chosen = sorted((one for one in record.measurements if one.target is not None), key=lambda m: order.index(m.item))
    return [
        Aim(
            title=one.title,
            item=one.item,
            question=question(one.item),
            value=with_unit(one.value, one.unit),
            spread=_repeated(one),
            target=target(one),
            tone=TONES[one.met],
            outcome=outcome(one),
            small=in_repetitions(one) if one.met is not None else one.detail or "no reason recorded",
        )
        for one in chosen
    ]


def _repeated(one: Measurement) -> str:
    if one.value is None:
        return ""
    return spread(one) or ("measured once" if one.repeats == 1 else counted(one.repeats, "repetition"))


def headline(found: list[Aim]) -> str:
    """How many targets are met, missed, and without a figure, which may be a miss as well."""
    if not found:
        return "Speed of training and rendering"
    met, missed, unmeasured = (sum(one.tone == tone for one in found) for tone in ("met", "missed", "unmeasured"))
    parts = [f"{met} of {counted(len(found), 'speed target')} met"]
    parts += [f"{missed} missed"] if missed else []
    parts += [f"{unmeasured} without a figure"] if unmeasured else []
    return ", ".join(parts)


def measurements_grid(record: SpeedRecord, item: int) -> Grid | None:
    """Every figure of a question; columns that would be empty are left out."""
    chosen = [one for one in record.measurements if one.item == item]
    if not chosen:
        return None
    with_spread = any(spread(one) for one in chosen)
    with_repeats = any(one.repeats > 1 for one in chosen)
    with_target = any(one.target is not None for one in chosen)
    columns = [Column("figure", numeric=False), Column("median" if with_repeats else "value")]
    columns += [Column("smallest – largest")] if with_spread else []
    columns += [Column("repetitions")] if with_repeats else []
    columns += [Column("target"), Column("outcome", numeric=False)] if with_target else []
    rows = []
    for one in chosen:
        row = [Entry(one.title, one.detail), _value(one)]
        row += [Entry(spread(one)) if spread(one) else EMPTY] if with_spread else []
        row += [Entry(figure(one.repeats)) if one.value is not None else EMPTY] if with_repeats else []
        if with_target:
            tone = TONES[one.met] if one.target is not None else "muted"
            row += [Entry(target(one)) if target(one) else EMPTY, Entry(outcome(one), in_repetitions(one), tone)]
        rows.append(row)
    return Grid(f"{question(item)}: figures", columns, rows)


def _value(one: Measurement) -> Entry:
    if one.value is None:
        return Entry(NOTHING, "no figure" if one.detail else "no figure, no reason recorded", "unmeasured")
    return Entry(with_unit(one.value, one.unit))


@dataclass(frozen=True)
class Section:
    item: int
    title: str
    measurements: Grid | None
    charts: list[Chart]
    tables: list[Grid]


def speed_page(record: SpeedRecord, beside_report: bool = False) -> str:
    """The whole page as text; `beside_report` says that report.html lies in the same folder."""
    targets = aims(record)
    return (
        shell.environment()
        .get_template("speed_page.html")
        .render(
            policy=content_policy(shell.code()),
            script=Markup(shell.code()),
            style=shell.style("page.css", "explore.css", "speed_page.css"),
            colours={},
            title=headline(targets),
            machine=machine(record.provenance),
            effort=effort(record),
            quick=is_quick(record),
            report=shell.RUN_PAGE if beside_report else "",
            aims=targets,
            sections=[section(record, item) for item in items(record)],
            provenance=provenance(record),
        )
    )


def section(record: SpeedRecord, item: int) -> Section:
    return Section(
        item,
        question(item),
        measurements_grid(record, item),
        charts(record.series, item, "speed"),
        tables_grids(record.tables, item, wording.figure),
    )


def machine(origin: dict[str, Any]) -> str:
    """`Measured on X with 2 cores and 2 threads, which multiply bfloat16 matrices fast.`"""
    words = f"Measured on {_known(origin, 'processor') or 'an unnamed processor'}"
    parts = [
        wording.counted(origin[name], noun)
        for name, noun in (("cores", "core"), ("threads", "thread"))
        if isinstance(origin.get(name), int)
    ]
    words += f" with {wording.listed(parts)}" if parts else ""
    device = _known(origin, "device")
    words += f", on its {device}" if device not in ("", "cpu") else ""
    has = origin.get("bfloat16_products")
    if isinstance(has, bool):
        words += f", {'with' if has else 'without'} units for bfloat16 matrix products"
    return f"{words}."


def effort(record: SpeedRecord) -> str:
    """`32 figures in 12 min 05 s.`"""
    measured = sum(one.value is not None for one in record.measurements)
    if not record.measurements:
        return "No figure was recorded."
    total = record.seconds.get("total")
    words = wording.counted(measured, "figure")
    lost = len(record.measurements) - measured
    words += f", {wording.count(lost)} more could not be measured" if lost else ""
    return f"{words}; the run took {wording.duration(total)}." if total is not None else f"{words}."


def _known(origin: dict[str, Any], name: str) -> str:
    value = origin.get(name)
    return value if isinstance(value, str) else ""


def provenance(record: SpeedRecord) -> list[tuple[str, list[tuple[str, str]]]]:
    """Groups of name and value: how to get the same again, and how long that takes."""
    spent = [(_named(name), wording.duration(seconds)) for name, seconds in record.seconds.items()]
    return shell.groups_of(record.provenance, record.settings, spent)


def _named(key: str) -> str:
    """Seconds are kept by a question's number."""
    return question(int(key)) if key.isascii() and key.isdecimal() else key


def write_speed_page(record: SpeedRecord, path: Path, beside_report: bool = False) -> None:
    shell.write_whole(speed_page(record, beside_report), path)
