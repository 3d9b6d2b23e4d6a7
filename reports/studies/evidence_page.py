"""An evidence record → evidence.html and the sections of the report, both self-contained."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from harness.records.study import Check, Effect, Studies, StudyInfo, StudyRecord
from reports.data import wording
from reports.data.wording import after, counted, duration, interval, listed, number, of_any_size, signed
from reports.drawing.series_charts import Chart, charts
from reports.page import shell
from reports.page.grid import EMPTY, Column, Entry, Grid, tables_grids
from reports.page.script import content_policy
from reports.studies.effects_plot import BUDGETS, Forest, forests, metric_of, scene_said
from scenes.files.atomic import write_atomically

AT_ONCE = 4
"""The number of findings in sight besides the answer."""
HOLDS, FAILS = "✓ holds", "✕ does not hold"


@dataclass(frozen=True)
class StudyShown:
    anchor: str
    info: StudyInfo
    answer: str
    findings: list[str]
    """The other findings that are in sight."""
    more: list[str]
    """The remaining findings, which are unfolded on request."""
    scale: str
    failed: bool
    checks: Grid | None
    forests: list[Forest]
    """The forests of the metric that comes first."""
    others: list[Forest]
    """The forests of the other metrics."""
    effects: Grid | None
    charts: list[Chart]
    tables: list[Grid]
    seconds: str


@dataclass(frozen=True)
class Evidence:
    headline: str
    failed: list[tuple[str, str]]
    """The anchor of the study, and what does not hold."""
    finished: bool
    quick: bool
    studies: list[StudyShown]


def evidence(record: Studies) -> Evidence:
    return Evidence(
        headline=headline(record),
        failed=[(anchor(study), f"{study.info.title} {check_said(check)}") for study, check in record.broken],
        finished=record.finished,
        quick=record.is_quick,
        studies=[study_shown(study, of_interest(record)) for study in record.studies],
    )


def of_interest(record: Studies) -> dict[str, float]:
    """Return metric → the smallest effect of interest, as far as the record knows it."""
    known: Any = record.settings.get("smallest_of_interest")
    return {str(name): float(value) for name, value in known.items()} if isinstance(known, dict) else {}


def headline(record: Studies) -> str:
    """Return the main message of the page: whether the rest may be trusted."""
    every, lost = list(record.checks()), record.broken
    if not every:
        return f"Evidence: {counted(len(record.studies), 'study', 'studies')}, without a check"
    if lost:
        fails = "does not hold" if len(lost) == 1 else "do not hold"
        return f"{len(lost)} of {counted(len(every), 'check')} of the evidence {fails}"
    return f"All {len(every)} checks of the evidence hold" if len(every) > 1 else "The one check of the evidence holds"


def anchor(study: StudyRecord) -> str:
    return shell.anchor("study", study.info.id)


def study_shown(study: StudyRecord, of_interest: dict[str, float]) -> StudyShown:
    drawn = forests(study.effects, of_interest)
    first = len({one.budget for one in study.effects if one.metric == study.effects[0].metric}) if drawn else 0
    answer, *findings = study.answers or ["It gave no answer in words."]
    return StudyShown(
        anchor=anchor(study),
        info=study.info,
        answer=answer,
        findings=findings[:AT_ONCE],
        more=findings[AT_ONCE:],
        scale=study.scale,
        failed=any(not check.holds for check in study.checks),
        checks=checks_grid(study.checks) if study.checks else None,
        forests=drawn[:first],
        others=drawn[first:],
        effects=effects_grid(study.effects) if study.effects else None,
        charts=charts(study.series, anchor(study)),
        tables=tables_grids(study.tables, of_any_size),
        seconds=duration(study.seconds) if study.seconds else "",
    )


def checks_grid(checks: list[Check]) -> Grid:
    """Return the checks; what does not hold comes first."""
    columns = [Column("what must hold", numeric=False), Column("measured"), Column("wanted"), Column("")]
    rows = [
        [
            Entry(one.what, one.why),
            Entry(figure_said(one), tone="" if one.holds else "fails"),
            Entry(wanted(one), tone="muted"),
            Entry(HOLDS, tone="holds") if one.holds else Entry(FAILS, tone="fails"),
        ]
        for one in sorted(checks, key=lambda check: check.holds)
    ]
    return Grid("What must hold before the rest may be trusted", columns, rows)


def check_said(one: Check) -> str:
    """Return a line such as `share of A/A comparisons that are called better or worse: 0.081, wanted ≤ 0.05 (why)`."""
    limits = f", wanted {wanted(one)}" if wanted(one) else ""
    return f"{one.what}: {figure_said(one)}{limits}" + (f" ({one.why})" if one.why else "")


def figure_said(one: Check) -> str:
    """Return the figure with as many digits as it takes to distinguish a failing one from its limits."""
    if one.value is None:
        return "no figure"
    limits = [limit for limit in (one.low, one.high) if limit is not None]
    enough = (
        digits
        for digits in range(3, 16)
        if one.holds or all(of_any_size(one.value, digits) != of_any_size(limit, digits) for limit in limits)
    )
    return f"{of_any_size(one.value, next(enough, 16))}{after(one.unit)}"


def wanted(one: Check) -> str:
    """Return the limits as `≤ 0.05` or `0.8 … 1`; empty without any."""
    low, high = (None if limit is None else plain(limit) for limit in (one.low, one.high))
    if low and high:
        return f"{low} … {high}{after(one.unit)}"
    return f"≥ {low}{after(one.unit)}" if low else f"≤ {high}{after(one.unit)}" if high else ""


def plain(value: float) -> str:
    """Return a limit without superfluous digits: 0.05, 30."""
    return number(value, 3).rstrip("0").rstrip(".") if 1e-3 <= abs(value) < 1e3 else of_any_size(value, 2)


def effects_grid(effects: list[Effect]) -> Grid:
    """Return every effect with all facts about it."""
    labels = ("effect", "against", "scene", "metric", "budget")
    figures = ("difference", "95 % interval", "simultaneous", "of", "could detect", "pairs", "unpaired")
    columns = [*(Column(one, numeric=False) for one in labels), *map(Column, figures), Column("verdict", numeric=False)]
    rows = []
    for one in effects:
        metric = metric_of(one.metric)
        rows.append(
            [
                Entry(one.name, one.note),
                Entry(one.against) if one.against else EMPTY,
                Entry(scene_said(one.scene)),
                Entry(metric.label),
                Entry(BUDGETS[one.budget].removeprefix("at ")),
                Entry(
                    f"{signed(one.difference, metric.digits)}{after(metric.unit)}"
                    if one.difference is not None
                    else "–"
                ),
                Entry(interval(one.interval, metric.digits) or "–"),
                Entry(interval(one.simultaneous, metric.digits) or "–"),
                Entry(str(one.family), tone="muted"),
                Entry(number(one.smallest_detectable, metric.digits)),
                Entry(str(one.pairs), tone="muted"),
                Entry(str(one.unpaired), tone="fails" if one.unpaired else "muted"),
                Entry(one.verdict, tone=one.verdict),
            ]
        )
    note = (
        "The verdict is taken from the simultaneous interval: of as many intervals as “of” says, all hold the truth "
        "together in 95 % of repetitions. “could detect”: the true difference that such a sample, with this spread, "
        "would tell from 0 in 80 % of repetitions."
    )
    return Grid(f"Every effect: {counted(len(effects), 'comparison')}", columns, rows, note=note)


def sentences(record: Studies) -> list[str]:
    """Return how many questions were examined, and how long it took."""
    if not record.studies:
        return ["No study is whole."]
    seconds = sum(study.seconds for study in record.studies)
    effects = sum(len(study.effects) for study in record.studies)
    parts = [counted(len(list(record.checks())), "check"), counted(effects, "effect")]
    took = f", in {duration(seconds)} of measuring and training" if seconds else ""
    return [f"{counted(len(record.studies), 'study', 'studies')} with {listed(parts)}{took}."]


def evidence_page(record: Studies) -> str:
    """Return the complete page as text."""
    shown = evidence(record)
    return (
        shell.environment()
        .get_template("evidence_page.html")
        .render(
            policy=content_policy(shell.code()),
            script=Markup(shell.code()),
            style=shell.style("page.css", "explore.css", "evidence.css"),
            colours={},
            title=shown.headline,
            evidence=shown,
            sentences=sentences(record),
            provenance=provenance(record),
        )
    )


def provenance(record: Studies) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return groups of name and value: how to reproduce the figures, and how long that takes."""
    spent = [(study.info.title, wording.duration(study.seconds)) for study in record.studies if study.seconds]
    return shell.groups_of(record.provenance, record.settings, spent)


def write_evidence_page(record: Studies, out: Path) -> Path:
    """Write the page into `out`; returns its path."""
    path = out / shell.EVIDENCE_PAGE
    write_atomically(path, evidence_page(record), fsync=False)
    return path
