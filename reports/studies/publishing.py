"""The figures of the studies that the README shows: their records, each with the small plots that show most."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import msgspec
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from harness.records.serving_record import SERVING_FILE, AttentionRecord, Measure, ServingRecord, write_serving
from harness.records.study import SHELVES, Check, Effect, Picture, Series, Studies, StudyRecord, write_studies
from reports.data.wording import with_unit
from reports.drawing import palette
from reports.drawing.figure import STYLE, padded, paint, subdivisions, tick
from reports.drawing.images import save
from reports.drawing.palette import INK, MUTED, Pen, pens_of
from reports.drawing.series_charts import panel, panels_of, pens_in, points, with_points
from reports.drawing.traces import Panel
from reports.studies.effects_plot import BUDGETS, Axis, axis_of, metric_of
from reports.studies.evidence_page import of_interest
from reports.studies.serving_cache import latency_panels, pens_of_methods
from reports.studies.serving_curves import PENS, anytime_panels
from reports.studies.serving_said import MAPS
from reports.studies.stability_matrix import LEGEND, MARKS, OWNERS, Tone, cell, tone_of

MATRIX, CURVES = "stability.png", "stability_curves.png"
CHAPTERS_DRAWN = (1, 2, 3, 9)
"""Rounding, truncation, gradients, ladders: the first chart of each is drawn."""
INKS: dict[Tone, str] = {
    "passes": "#00654c",
    "fails": "#a8330a",
    "property": "#7a3d8c",
    "unsettled": palette.MUTED.light,
    "absent": palette.MUTED.light,
    "spared": palette.MUTED.light,
}
GROUNDS: dict[Tone, str] = {"passes": "#e4f2ee", "fails": "#f7b8a0", "property": "#ecd9f1"}
TITLE_WIDTH = 14.0
"""The width of the column of titles, in squares."""
LEAST_WIDTH = 9.0
"""The least width of the squares of one owner: its name stands above them."""
LEGEND_WIDTH = 40.0


def write_published_stability(record: Studies, folder: Path) -> list[Path]:
    """Write the record without its pictures, which are left out, and a PNG for each of what there is to draw."""
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / SHELVES["stability"]]
    write_studies(written[0], without(record, Picture))
    with matplotlib.rc_context(STYLE):
        for name, figure in ((MATRIX, miniature(record)), (CURVES, curves(record))):
            if figure is not None:
                save(figure, folder / name)
                written.append(folder / name)
    return written


def without(record: Studies, kind: type) -> Studies:
    """Return the record without its findings of one kind."""
    kept = [
        msgspec.structs.replace(study, findings=[one for one in study.findings if not isinstance(one, kind)])
        for study in record.studies
    ]
    return msgspec.structs.replace(record, studies=kept)


def miniature(record: Studies) -> Figure | None:
    """Draw a row per case, and a square per subject, below the owner of its form, marked by its outcome."""
    cases = [case for case in record.studies if case.checks]
    if not cases:
        return None
    widths = {whose: max(len(squares(case, whose)) for case in cases) for whose in OWNERS}
    owners = [whose for whose in OWNERS if widths[whose]]
    wide = {whose: max(widths[whose] + 1.0, LEAST_WIDTH) for whose in owners}
    starts = {whose: TITLE_WIDTH + sum(wide[one] for one in owners[:place]) for place, whose in enumerate(owners)}
    width = max(TITLE_WIDTH + sum(wide.values()), LEGEND_WIDTH)
    figure = Figure(figsize=(0.21 * width, 0.21 * (len(cases) + 3)))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(len(cases) + 1.6, -1.4)
    for whose in owners:
        axes.text(starts[whose], -0.35, OWNERS[whose].removeprefix("the "), fontsize=7.5, color=palette.MUTED.light)
    for line, case in enumerate(cases):
        axes.text(0, line + 0.5, case.info.id, fontsize=8, weight="bold", va="center", color=palette.INK.light)
        axes.text(1.8, line + 0.5, case.info.title, fontsize=8, va="center", color=palette.INK.light)
        for whose in owners:
            for place, tone in enumerate(squares(case, whose)):
                _square(axes, starts[whose] + place, line, tone)
    _legend(axes, len(cases) + 0.6, {tone_of(one) for _, one in record.checks()})
    return figure


def squares(case: StudyRecord, whose: str) -> list[Tone]:
    """Return the outcome of each subject of one owner."""
    chosen = [one for one in case.checks if one.owner == whose]
    subjects = dict.fromkeys(one.subject for one in chosen)
    return [cell([one for one in chosen if one.subject == subject]).tone for subject in subjects]


def _square(axes: Axes, x: float, y: float, tone: Tone) -> None:
    axes.add_patch(matplotlib.patches.Rectangle((x, y + 0.06), 0.88, 0.88, color=GROUNDS.get(tone, "#f3f3f4"), lw=0))
    axes.text(x + 0.44, y + 0.52, MARKS[tone], fontsize=7.5, ha="center", va="center", color=INKS[tone])


def _legend(axes: Axes, y: float, tones: set[Tone]) -> None:
    short = {"passes": "passes", "fails": "fails, and is ours", "property": "fails: a property of that form"}
    x = 0.0
    for tone, words in LEGEND:
        if tone in tones:
            said = short.get(tone, words)
            _square(axes, x, y, tone)
            axes.text(x + 1.1, y + 0.5, said, fontsize=7.5, va="center", color=palette.MUTED.light)
            x += 2.4 + 0.31 * len(said)


def curves(record: Studies) -> Figure | None:
    """Draw the first chart of each chosen chapter, side by side."""
    series = [one for case in record.studies for one in case.series]
    chosen = [found for item in CHAPTERS_DRAWN if (found := first_chart([one for one in series if one.item == item]))]
    if not chosen:
        return None
    across = min(2, len(chosen))
    down = math.ceil(len(chosen) / across)
    figure = Figure(figsize=(5.4 * across, 4.6 * down), layout="constrained")
    grid = figure.subplots(down, across, squeeze=False)
    for axes in list(grid.flat)[len(chosen) :]:
        axes.set_visible(False)
    for axes, (title, group, pens) in zip(grid.flat, chosen, strict=False):
        chart(axes, title, group, pens)
    return figure


def chart(axes: Axes, title: str, group: list[Series], pens: dict[str, Pen]) -> None:
    """Draw one chart as the page shows it, with its title above and its key below."""
    paint(axes, panel(title, group, pens))
    axes.set_title(title, fontsize=9, loc="left", color=palette.INK.light)
    keys(axes, dict.fromkeys(one.name for one in group), pens)


def first_chart(series: list[Series]) -> tuple[str, list[Series], dict[str, Pen]] | None:
    """Return title, lines and pens of the first chart of a chapter, if it has one."""
    drawn = with_points(series)
    charts = panels_of(drawn)
    return (*charts[0], pens_in(drawn)) if charts else None


def keys(axes: Axes, names: Iterable[str], pens: dict[str, Pen]) -> None:
    """Draw the key of a chart's lines, below it."""
    handles = [
        axes.plot(
            [], [], label=name, color=pens[name].colour.light, marker=pens[name].marker, markersize=4.6,
            linestyle=(0, pens[name].dash) if pens[name].dash else "-",
            markerfacecolor="white" if pens[name].hollow else pens[name].colour.light,
        )[0]
        for name in names
    ]  # fmt: skip
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False, fontsize=6.5)


EFFECTS, BANDWIDTH = "evidence_effects.png", "bandwidth.png"
LARGEST = 500_000
"""The largest size in bytes of a published record; a longer one is left without its lines."""


def write_published_evidence(record: Studies, folder: Path) -> list[Path]:
    """Write the record, and a PNG for each of what there is to draw; returns the written paths."""
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / SHELVES["evidence"]]
    write_studies(written[0], record)
    if written[0].stat().st_size > LARGEST:
        write_studies(written[0], without(record, Series))
    with matplotlib.rc_context(STYLE):
        for name, figure in ((EFFECTS, effects_figure(record)), (BANDWIDTH, bandwidth_figure(record))):
            if figure is not None:
                save(figure, folder / name)
                written.append(folder / name)
    return written


def effects_figure(record: Studies) -> Figure | None:
    """Draw what each part does to PSNR over all scenes, at equal steps and at equal time, side by side."""
    study = record.study("factorial")
    effects = [one for one in study.effects if (one.metric, one.scene) == ("psnr", "all")] if study else []
    effects = [one for one in effects if not one.against and one.difference is not None]
    budgets = [budget for budget in BUDGETS if any(one.budget == budget for one in effects)]
    if not budgets:
        return None
    names = list(dict.fromkeys(map(_name, effects)))
    figure = Figure(figsize=(2.2 + 3.2 * len(budgets), 0.9 + 0.27 * len(names)), layout="constrained")
    band = of_interest(record).get("psnr", 0.0)
    axis = axis_of(effects, band)
    every = figure.subplots(1, len(budgets), squeeze=False, sharey=True)[0]
    for axes, budget in zip(every, budgets, strict=True):
        axes.axvspan(-band, band, color=palette.RULE.light, lw=0)
        axes.axvline(0.0, color=palette.INK.light, lw=0.8)
        for one in effects:
            if one.budget == budget:
                _row(axes, one, axis, names.index(_name(one)))
        axes.set_xlim(axis.low, axis.high)
        axes.set_title(BUDGETS[budget], fontsize=9, loc="left", color=palette.INK.light)
        axes.set_xlabel(f"difference in test {metric_of('psnr').label} (dB)")
        axes.grid(axis="y", visible=False)
    every[0].set_ylim(len(names) - 0.5, -0.6)
    every[0].set_yticks(range(len(names)), names, color=palette.INK.light)
    figure.supxlabel(
        "all scenes; dark bar: 95 % interval of one effect alone; pale: of all effects at once, from which the verdict "
        "is taken; arrow: it goes on\nfilled dot: settled; grey band: too small to matter",
        fontsize=7.5,
        color=palette.MUTED.light,
    )
    return figure


def _name(one: Effect) -> str:
    """Return the name, with its note if effects of one name differ by it."""
    return f"{one.name} ({one.note})" if one.note else one.name


def _row(axes: Axes, one: Effect, axis: Axis, place: int) -> None:
    """Draw a row. The pale bar is the interval that the verdict is taken from, the dark one that of this effect
    alone.
    """
    colour = palette.KNOWN["nerf"].light
    settled = one.verdict in ("better", "worse")
    for pair, width, alpha in ((one.simultaneous, 6.0, 0.3), (one.interval, 1.8, 1.0)):
        if pair is not None:
            axes.hlines(place, max(pair[0], axis.low), min(pair[1], axis.high), color=colour, lw=width, alpha=alpha)
            for at, beyond, head in ((axis.low, pair[0] < axis.low, "<"), (axis.high, pair[1] > axis.high, ">")):
                if beyond:
                    axes.plot([at], [place], head, ms=5, color=colour, clip_on=False)
    axes.plot([one.difference or 0.0], [place], "o", ms=5.5, mec=colour, mfc=colour if settled else "white", mew=1.4)


def bandwidth_figure(record: Studies) -> Figure | None:
    """Draw the first chart of the study: how far φ and its controls are from NeRF, over resolution."""
    study = record.study("bandwidth")
    found = first_chart(study.series) if study else None
    if found is None:
        return None
    figure = Figure(figsize=(5.4, 4.2), layout="constrained")
    chart(figure.add_subplot(), *found)
    return figure


PLOT = "serving.png"
MEASURES_DRAWN: dict[Measure, str] = {"whole": "whole picture", "hardest": "its hardest quarter"}


def write_published_serving(record: ServingRecord, methods: list[str], folder: Path) -> list[Path]:
    """Write the record without pictures and curves (summary.json holds those), and a plot if there is something to
    draw.

    Returns the written paths.
    """
    folder.mkdir(parents=True, exist_ok=True)
    attention = record.attention and replace(record.attention, frames=[], curves=[])
    write_serving(folder, replace(record, attention=attention))
    written = [folder / SERVING_FILE]
    with matplotlib.rc_context(STYLE):
        figure = serving_figure(record, methods)
        if figure is not None:
            save(figure, folder / PLOT)
            written.append(folder / PLOT)
    return written


def serving_figure(record: ServingRecord, methods: list[str]) -> Figure | None:
    """Draw latencies on the first scene, and error over time on the first scene, by the first map, attended and
    complete.
    """
    drawn: list[tuple[str, Panel, dict[str, Pen]]] = []
    if record.cache is not None and record.cache.latencies:
        pens = pens_of_methods(methods, [one.method for one in record.cache.latencies])
        pens = {name: pens[name] for name in dict.fromkeys(one.method for one in record.cache.latencies)}
        panel = latency_panels(record.cache, pens)[0]
        drawn.append((f"time of a view, {panel.title} (grey: target)", panel, pens))
    if record.attention is not None and record.attention.curves:
        drawn += _curves(record.attention)
    if not drawn:
        return None
    figure = Figure(figsize=(3.9 * len(drawn), 3.5), layout="constrained")
    for axes, (title, panel, pens) in zip(figure.subplots(1, len(drawn), squeeze=False)[0], drawn, strict=True):
        _chart(axes, title, panel, pens)
    return figure


def _curves(record: AttentionRecord) -> list[tuple[str, Panel, dict[str, Pen]]]:
    first = record.curves[0]
    chosen = [one for one in record.curves
              if (one.scene, one.method, one.attention) == (first.scene, first.method, first.attention)]  # fmt: skip
    pens = {one.order: PENS[one.order] for one in chosen}
    about = f"{first.scene}, {MAPS.get(first.attention, first.attention)}"
    return [
        (
            f"{what}, {about}",
            anytime_panels(chosen[::-1], record.reaching, measure)[0],
            {str(name): pen for name, pen in pens.items()},
        )
        for measure, what in MEASURES_DRAWN.items()
    ]


def _chart(axes: Axes, title: str, panel: Panel, pens: dict[str, Pen]) -> None:
    paint(axes, panel)
    axes.set_title(title, fontsize=9, loc="left", color=palette.INK.light)
    keys(axes, pens, pens)


TIME_TO_TARGET = "3"
DASHED: dict[str, Any] = {"color": MUTED.light, "linewidth": 1.0, "linestyle": (0, (4, 3)), "zorder": 1}


def write_published_speed(record: Studies, folder: Path) -> list[Path]:
    """Write speed.json and, if there is something to draw, speed.png; returns the written paths."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / SHELVES["speed"]
    write_studies(path, record)
    with matplotlib.rc_context(STYLE):
        figure = time_to_target(record) or ratios(record)
        if figure is None:
            return [path]
        save(figure, folder / "speed.png")
    return [path, folder / "speed.png"]


def time_to_target(record: Studies) -> Figure | None:
    """Draw the curves of question 3, one panel each; dashed, the best that the first line of a panel reached."""
    study = record.study(TIME_TO_TARGET)
    drawn = [one for one in study.series if one.x and min(one.x) > 0] if study else []
    if not drawn:
        return None
    panels = list(dict.fromkeys(one.panel for one in drawn))
    pens = pens_of(one.name for one in drawn)
    across = min(3, len(panels))
    down = math.ceil(len(panels) / across)
    figure = Figure(figsize=(0.5 + 2.7 * across, 0.5 + 2.1 * down), layout="constrained")
    grid = figure.subplots(down, across, squeeze=False, sharex=True)
    for axes in list(grid.flat)[len(panels) :]:
        axes.set_visible(False)
    for axes, shown, title in zip(grid.flat, panels, short(panels), strict=False):
        group = [one for one in drawn if one.panel == shown]
        for one in group:
            _curve(axes, one, pens[one.name])
        reached = [point.y for point in points(group[0]) if point.y is not None]
        if reached:
            axes.axhline(max(reached), **DASHED)
        axes.set_title(title, fontsize=9, loc="left", color=INK.light)
    low, high = padded([x for one in drawn for x in one.x], log=True) or (1.0, 10.0)
    _log(grid.flat[0], low, high)
    figure.supxlabel(drawn[0].x_label, fontsize=9, color=MUTED.light)
    figure.supylabel(drawn[0].y_label, fontsize=9, color=MUTED.light)
    handles = [grid.flat[0].plot([], [], **_marker(pen), label=name)[0] for name, pen in pens.items()]
    handles += grid.flat[0].plot([], [], **DASHED, label=f"best of {drawn[0].name}")
    figure.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 0.99), ncols=min(4, len(handles)), frameon=False
    )
    return figure


def _curve(axes: Axes, one: Series, pen: Pen) -> None:
    style = {**_marker(pen), "linestyle": "-", "linewidth": 1.8, "markersize": 3.5, "markeredgewidth": 1.0}
    line = [(point.x, math.nan if point.y is None else point.y) for point in points(one)]
    axes.plot(*zip(*line, strict=True), color=pen.colour.light, **style)


def short(titles: list[str]) -> list[str]:
    """Return titles without the words that all begin with."""
    if len(titles) < 2:
        return titles
    words = [title.split(" ") for title in titles]
    shared = 0
    while all(len(one) > shared + 1 and one[shared] == words[0][shared] for one in words):
        shared += 1
    return [" ".join(one[shared:]) for one in words]


def ratios(record: Studies) -> Figure | None:
    """Draw every ratio with a target: the measured value, and a bar at the target."""
    chosen = [one for _, one in record.checks() if one.unit == "×" and one.low]
    drawn = [one for one in chosen if one.value is not None and one.value > 0]
    if not drawn:
        return None
    figure = Figure(figsize=(6.6, 0.9 + 0.42 * len(drawn)), layout="constrained")
    axes = figure.add_subplot()
    pen = pens_of(["measured"])["measured"]
    edges = [v for one in drawn for v in (one.value, *(one.spread or ()), one.low) if v is not None and v > 0]
    low, high = padded(edges, log=True) or (1.0, 10.0)
    for place, one in enumerate(drawn):
        axes.vlines(one.low or 0.0, place - 0.3, place + 0.3, color=INK.light, linewidth=1.6)
        _dot(axes, one, place, pen, with_unit(one.value, one.unit))
    _rows(axes, [one.what for one in drawn])
    _log(axes, low / 1.1, high * 1.1)
    axes.set_xlabel("times as fast (upright bar: the target)")
    return figure


def _dot(axes: Axes, one: Check, place: int, pen: Pen, words: str) -> None:
    value = one.value if one.value is not None else 0.0
    if one.spread is not None and one.spread[0] > 0:
        axes.hlines(place, *one.spread, color=pen.colour.light, linewidth=3.0, alpha=0.35)
    axes.plot([value], [place], **_marker(pen))
    axes.annotate(
        words, (value, place), (0, 6), textcoords="offset points", ha="center", fontsize=8, color=pen.colour.light
    )


def _marker(pen: Pen) -> dict[str, Any]:
    return {
        "linestyle": "",
        "marker": pen.marker,
        "markersize": 6.0,
        "markerfacecolor": "white" if pen.hollow else pen.colour.light,
        "markeredgecolor": pen.colour.light,
        "markeredgewidth": 1.4,
        "zorder": 3,
    }


def _rows(axes: Axes, names: list[str]) -> None:
    axes.set_ylim(len(names) - 0.45, -0.65)
    axes.yaxis.set_major_locator(FixedLocator(range(len(names))))
    axes.set_yticklabels(names, color=INK.light)
    axes.yaxis.set_minor_locator(NullLocator())
    axes.grid(axis="y", visible=False)


def _log(axes: Axes, low: float, high: float) -> None:
    axes.set_xscale("log")
    axes.set_xlim(low, high)
    axes.xaxis.set_major_locator(LogLocator(subs=subdivisions(math.log10(high / low)), numticks=10))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda at, _: tick(at)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_minor_formatter(NullFormatter())
