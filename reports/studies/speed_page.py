"""A speed record → speed.html: how fast this machine is, in the same design as the report and as self-contained."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from harness.records.study import Check, Studies, StudyRecord
from reports.data import wording
from reports.data.wording import NARROW, NOTHING, after, count, counted, figure, number, significant, with_unit
from reports.drawing.series_charts import Chart, charts
from reports.page import shell
from reports.page.grid import EMPTY, Column, Entry, Grid, tables_grids
from reports.page.script import content_policy
from scenes.files.atomic import write_atomically

SMALL_FACTOR = 2.0
"""The largest factor that is shown as a percentage; a larger distance from the target is a factor."""


def spread(one: Check) -> str:
    """Return the spread as `7.11–7.63×`; empty if it was not repeated."""
    if one.spread is None or one.value is None:
        return ""
    low, high = one.spread
    if one.repeats < 2 and low == high:
        return ""
    join = " to " if min(low, high) < 0 else "–"
    return f"{figure(low)}{join}{figure(high)}{after(one.unit)}"


def target(one: Check) -> str:
    """Return the target as `≥ 10×`, without superfluous digits."""
    if one.limit is None:
        return ""
    short = f"{one.limit:.6g}"
    text = count(round(one.limit)) if float(short).is_integer() else short if "e" not in short else figure(one.limit)
    return f"{'≤' if one.low is None else '≥'} {text}{after(one.unit)}"


def outcome(one: Check) -> str:
    """Return `met, 12 % above`, `missed by 6.9 points` or `no figure, so not met`; empty without a target."""
    if one.limit is None:
        return ""
    if one.value is None:
        return "no figure, so not met"
    if one.value == one.limit:
        return "met exactly"
    return _met(one.value, one.limit, one) if one.holds else f"missed{_shortfall(one.value, one.limit, one.unit)}"


def _met(value: float, goal: float, one: Check) -> str:
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


def in_repetitions(one: Check) -> str:
    """Return how many repetitions meet the target if the spread straddles it: the median alone says too little."""
    if one.limit is None or one.value is None or one.spread is None:
        return ""
    worst, best = one.spread if one.high is None else reversed(one.spread)
    reached = [(edge >= one.limit if one.high is None else edge <= one.limit) for edge in (worst, best)]
    if one.holds and not reached[0]:
        return "not in every repetition"
    if not one.holds and reached[1]:
        return "reached in the best repetition"
    return ""


def _factor(value: float, goal: float) -> float | None:
    """Return how many times the larger is the smaller."""
    small, large = sorted((value, goal))
    return large / small if small > 0 and math.isfinite(large / small) else None


def _share(value: float, goal: float) -> str:
    return f"{_two_digits(100 * abs(value - goal) / goal)}{NARROW}%"


def _points(difference: float) -> str:
    return f"{_two_digits(abs(difference))} points"


def _two_digits(value: float) -> str:
    return significant(value, 2) if value < 10 else number(value, 0)


def tone_of(one: Check) -> str:
    """Return `met`, `missed` or `unmeasured`; `muted` without a target."""
    if one.limit is None:
        return "muted"
    return "unmeasured" if one.value is None else "met" if one.holds else "missed"


@dataclass(frozen=True)
class Aim:
    """One target and its outcome."""

    title: str
    item: str
    question: str
    value: str
    spread: str
    target: str
    tone: str
    """`met`, `missed` or `unmeasured`."""
    outcome: str
    small: str


def asked(record: Studies) -> list[StudyRecord]:
    """Return the questions that have something to show."""
    return [
        one
        for one in record.studies
        if one.checks or any(line.x for line in one.series) or any(table.rows and table.columns for table in one.tables)
    ]


def aims(record: Studies) -> list[Aim]:
    """Return every target, by question."""
    return [
        Aim(
            title=one.what,
            item=study.info.id,
            question=study.info.title,
            value=with_unit(one.value, one.unit),
            spread=_repeated(one),
            target=target(one),
            tone=tone_of(one),
            outcome=outcome(one),
            small=in_repetitions(one) if one.value is not None else one.why or "no reason recorded",
        )
        for study, one in record.checks()
        if one.limit is not None
    ]


def _repeated(one: Check) -> str:
    if one.value is None:
        return ""
    return spread(one) or ("measured once" if one.repeats == 1 else counted(one.repeats, "repetition"))


def headline(found: list[Aim]) -> str:
    """Return how many targets are met, missed, and without a figure, which may be a miss as well."""
    if not found:
        return "Speed of training and rendering"
    met, missed, unmeasured = (sum(one.tone == tone for one in found) for tone in ("met", "missed", "unmeasured"))
    parts = [f"{met} of {counted(len(found), 'speed target')} met"]
    parts += [f"{missed} missed"] if missed else []
    parts += [f"{unmeasured} without a figure"] if unmeasured else []
    return ", ".join(parts)


def measurements_grid(study: StudyRecord) -> Grid | None:
    """Return every figure of a question; columns that would be empty are left out."""
    chosen = study.checks
    if not chosen:
        return None
    with_spread = any(spread(one) for one in chosen)
    with_repeats = any(one.repeats > 1 for one in chosen)
    with_target = any(one.limit is not None for one in chosen)
    columns = [Column("figure", numeric=False), Column("median" if with_repeats else "value")]
    columns += [Column("smallest – largest")] if with_spread else []
    columns += [Column("repetitions")] if with_repeats else []
    columns += [Column("target"), Column("outcome", numeric=False)] if with_target else []
    rows = []
    for one in chosen:
        row = [Entry(one.what, one.why), _value(one)]
        row += [Entry(spread(one)) if spread(one) else EMPTY] if with_spread else []
        row += [Entry(figure(one.repeats)) if one.value is not None else EMPTY] if with_repeats else []
        if with_target:
            row += [Entry(target(one)) if target(one) else EMPTY]
            row += [Entry(outcome(one), in_repetitions(one), tone_of(one))]
        rows.append(row)
    return Grid(f"{study.info.title}: figures", columns, rows)


def _value(one: Check) -> Entry:
    if one.value is None:
        return Entry(NOTHING, "no figure" if one.why else "no figure, no reason recorded", "unmeasured")
    return Entry(with_unit(one.value, one.unit))


@dataclass(frozen=True)
class Section:
    item: str
    title: str
    measurements: Grid | None
    charts: list[Chart]
    tables: list[Grid]


def speed_page(record: Studies, beside_report: bool = False) -> str:
    """Return the complete page as text; `beside_report` says that report.html lies in the same folder."""
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
            quick=record.is_quick,
            report=shell.RUN_PAGE if beside_report else "",
            aims=targets,
            sections=[section(study) for study in asked(record)],
            provenance=provenance(record),
        )
    )


def section(study: StudyRecord) -> Section:
    return Section(
        study.info.id,
        study.info.title,
        measurements_grid(study),
        charts(study.series, shell.anchor("speed", study.info.id)),
        tables_grids(study.tables, wording.figure),
    )


def machine(origin: dict[str, Any]) -> str:
    """Return a sentence such as `Measured on X with 2 cores and 2 threads, which multiply bfloat16 matrices fast.`"""
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


def effort(record: Studies) -> str:
    """Return a sentence such as `32 figures in 12 min 05 s.`"""
    figures = [one.value for _, one in record.checks()]
    if not figures:
        return "No figure was recorded."
    lost = figures.count(None)
    words = wording.counted(len(figures) - lost, "figure")
    words += f", {wording.count(lost)} more could not be measured" if lost else ""
    total = sum(one.seconds for one in record.studies)
    return f"{words}; the run took {wording.duration(total)}." if total else f"{words}."


def _known(origin: dict[str, Any], name: str) -> str:
    value = origin.get(name)
    return value if isinstance(value, str) else ""


def provenance(record: Studies) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return groups of name and value: how to reproduce the figures, and how long that takes."""
    spent = [(study.info.title, wording.duration(study.seconds)) for study in record.studies if study.seconds]
    total = [("total", wording.duration(sum(study.seconds for study in record.studies)))] if spent else []
    return shell.groups_of(record.provenance, record.settings, [*spent, *total])


def write_speed_page(record: Studies, path: Path, beside_report: bool = False) -> None:
    write_atomically(path, speed_page(record, beside_report), fsync=False)
