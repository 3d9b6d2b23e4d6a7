"""What a README shows of a speed run: speed.json with every figure as a number, and one small chart.

The chart holds the curves of question 3, time to target; without them every ratio that has a target.
"""

import math
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator

from harness.chart_record import Series
from harness.speed_record import Measurement, SpeedRecord, write_speed
from reports.figure import STYLE, padded, subdivisions, tick
from reports.inline_png import save
from reports.palette import INK, MUTED
from reports.pens import Pen, pens_of
from reports.series_charts import points
from reports.speed_load import FILE
from reports.wording import with_unit

TIME_TO_TARGET = 3
DASHED: dict[str, Any] = {"color": MUTED.light, "linewidth": 1.0, "linestyle": (0, (4, 3)), "zorder": 1}


def write_published_speed(record: SpeedRecord, folder: Path) -> list[Path]:
    """speed.json and, where there is something to draw, speed.png; gives what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    write_speed(folder / FILE, record)
    with matplotlib.rc_context(STYLE):
        figure = time_to_target(record) or ratios(record)
        if figure is None:
            return [folder / FILE]
        save(figure, folder / "speed.png")
    return [folder / FILE, folder / "speed.png"]


def time_to_target(record: SpeedRecord) -> Figure | None:
    """The curves of question 3, a panel each; dashed, the best that the first line of a panel reached."""
    drawn = [one for one in record.series if one.item == TIME_TO_TARGET and one.x and min(one.x) > 0]
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
    for axes, panel, title in zip(grid.flat, panels, short(panels), strict=False):
        group = [one for one in drawn if one.panel == panel]
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
    """Titles without the words that all begin with."""
    if len(titles) < 2:
        return titles
    words = [title.split(" ") for title in titles]
    shared = 0
    while all(len(one) > shared + 1 and one[shared] == words[0][shared] for one in words):
        shared += 1
    return [" ".join(one[shared:]) for one in words]


def ratios(record: SpeedRecord) -> Figure | None:
    """Every ratio with a target: what was measured, and a bar where the target stands."""
    chosen = [one for one in record.measurements if (one.unit, one.sense) == ("×", "at_least") and one.target]
    drawn = [one for one in chosen if one.value is not None and one.value > 0]
    if not drawn:
        return None
    figure = Figure(figsize=(6.6, 0.9 + 0.42 * len(drawn)), layout="constrained")
    axes = figure.add_subplot()
    pen = pens_of(["measured"])["measured"]
    edges = [v for one in drawn for v in (one.value, one.low, one.high, one.target) if v is not None and v > 0]
    low, high = padded(edges, log=True) or (1.0, 10.0)
    for place, one in enumerate(drawn):
        axes.vlines(one.target or 0.0, place - 0.3, place + 0.3, color=INK.light, linewidth=1.6)
        _dot(axes, one, place, pen, with_unit(one.value, one.unit))
    _rows(axes, [one.title for one in drawn])
    _log(axes, low / 1.1, high * 1.1)
    axes.set_xlabel("times as fast (upright bar: the target)")
    return figure


def _dot(axes: Axes, one: Measurement, place: int, pen: Pen, words: str) -> None:
    value = one.value if one.value is not None else 0.0
    if one.low is not None and one.high is not None and one.low > 0:
        axes.hlines(place, one.low, one.high, color=pen.colour.light, linewidth=3.0, alpha=0.35)
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
