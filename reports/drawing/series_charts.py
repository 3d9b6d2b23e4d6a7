"""Series of a record → charts: one per panel, a band or bars if the spread is known, colour, marker and dash by name.
Panels that differ only in their subject are small multiples of the first.

Nothing is dropped silently: a zero on a logarithmic axis is drawn at its foot, a non-finite value at the upper edge.
"""

import math
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

from markupsafe import Markup

from harness.records.json_record import finite_or_none
from harness.records.study import Series
from reports.data.wording import of_any_size
from reports.drawing.figure import NAME_POINTS, padded, spread, svg, with_common_limits
from reports.drawing.palette import Pen, key, pens_of
from reports.drawing.traces import Panel, Trace

WIDE, SMALL = (5.8, 3.6), (2.9, 2.1)
MOST_BANDS = 3
"""The number of lines whose spread can be drawn as bands; more would cover each other and are bars."""
MARKED = 14
"""The maximum number of marked points of a line that has more than twice this number of points."""
FOOT = 10.0
"""The factor by which the foot of a logarithmic axis lies below the smallest positive value."""


LONGEST_END, FARTHEST = 18, 25.0
"""The letters of a name at the end of a line, and the points by which it may be moved."""


Drawn = tuple[Panel, dict[str, Pen]]


class Point(NamedTuple):
    x: float
    y: float | None
    """The value; None if it was not finite."""
    low: float | None
    high: float | None


class Chart(NamedTuple):
    title: str
    keys: list[tuple[str, Markup]]
    svg: Markup
    notes: list[str]
    wide: bool = False
    multiples: "tuple[Chart, ...]" = ()
    """The other charts of its family, small; its keys hold for all of them."""


def charts(series: list[Series], prefix: str) -> list[Chart]:
    """Return charts in the order of their first series; `prefix` makes ids unique in a page."""
    made: list[Chart] = []
    for (panel, pens), *others in families(panels_of(series)):
        small = [replace(other, size=SMALL, ends=(), labelled=False) for other, _ in others]
        if not any(other.zero_at for other in small):
            small = with_common_limits(small)
        multiples = tuple(
            Chart(other.title.rpartition(", ")[2], [], svg(other, f"{prefix}-{len(made)}-{place}"), _notes(other))
            for place, other in enumerate(small)
        )
        every = {name: pen for _, more in [(panel, pens), *others] for name, pen in more.items()}
        keys = [(name, key(pen)) for name, pen in every.items()]
        first = svg(panel, f"{prefix}-{len(made)}")
        made.append(Chart(panel.title, keys, first, _notes(panel), panel.size == WIDE, multiples))
    return made


def _notes(panel: Panel) -> list[str]:
    meanings = {"zero": "▽ exactly 0, drawn at the foot of the axis", "cross": "✕ not a finite number"}
    kinds = {trace.kind for trace in panel.traces}
    return [words for kind, words in meanings.items() if kind in kinds]


def families(drawn: list[Drawn]) -> list[list[Drawn]]:
    """Gather panels in a row of the same axes whose titles differ behind the last comma; two are not yet a family."""

    def kind(each: Drawn) -> tuple[object, ...]:
        panel, _ = each
        axes = panel.x_label, panel.y_label, panel.x_scale, panel.y_scale
        return (*axes, panel.title.rpartition(", ")[0] or panel.title)

    rows = [list(row) for _, row in groupby(drawn, key=kind)]
    return [part for row in rows for part in ([row] if len(row) > 2 else [[each] for each in row])]


def panels_of(series: list[Series]) -> list[Drawn]:
    """Return each chart with the pens of its lines, the same in every chart; charts without points are left out."""
    groups: dict[str, list[Series]] = {}
    for line in series:
        if line.x:
            groups.setdefault(line.panel, []).append(line)
    pens = pens_of(*([line.name for line in group] for group in groups.values()))
    return [
        (_panel(title, group, pens), {line.name: pens[line.name] for line in group}) for title, group in groups.items()
    ]


def _panel(title: str, group: list[Series], pens: dict[str, Pen]) -> Panel:
    """Return bands, then lines, then markers on top, so that a single point is visible too."""
    lines = [points(line) for line in group]
    every = [point for line in lines for point in line]
    all_x = [point.x for point in every]
    all_y = [value for point in every for value in point[1:] if value is not None]
    log_x = all(line.log_x for line in group) and min(all_x) > 0
    log_y = all(line.log_y for line in group) and bool(all_y) and min(all_y) >= 0 and max(all_y) > 0
    foot = min((value for value in all_y if value > 0), default=1.0) / FOOT if log_y and min(all_y) == 0 else None
    limits = padded([foot, *filter(None, all_y)] if foot is not None else all_y, log_y)
    top = limits[1] if limits else 1.0
    few = sum(line.low is not None for line in group) <= MOST_BANDS
    pairs, size = list(zip(group, lines, strict=True)), WIDE if len(group) > 5 else (4.3, 2.9)
    parts = [_traces(line.name, pens[line.name], known, foot, top, few) for line, known in pairs]
    return Panel(
        title,
        group[0].x_label,
        group[0].y_label,
        tuple(trace for layer in zip(*parts, strict=True) for traces in layer for trace in traces),
        _description(title, group, lines),
        "log" if log_x else "linear",
        "log" if log_y else "linear",
        padded(all_x, log_x),
        limits,
        size=size,
        zero_at=foot,
        ends=_ends(pairs, pens, limits, log_y, 72.0 * (size[1] - 0.62)),
    )


def _ends(
    pairs: list[tuple[Series, list[Point]]],
    pens: dict[str, Pen],
    limits: tuple[float, float] | None,
    log: bool,
    height: float,
) -> tuple[tuple[str, str, float, float], ...]:
    """Return the ends of lines, if their names fit next to axes of this height in points; else the key has to do."""
    ends = [(line.name, pens[line.name].colour.light, *_last(known)) for line, known in pairs if _last(known)]
    if limits is None or not MOST_BANDS < len(ends) == len(pairs) or max(len(end[0]) for end in ends) > LONGEST_END:
        return ()
    low, high, *at = (math.log(each) if log else each for each in (*limits, *(end[3] for end in ends)))
    places = sorted(height * (each - low) / (high - low) for each in at)
    moved = [abs(to - place) for to, place in zip(spread(places, NAME_POINTS), places, strict=True)]
    return tuple(ends) if max(moved) <= FARTHEST else ()


def _last(line: list[Point]) -> tuple[float, float] | tuple[()]:
    """Return the last point that is above 0 or on a linear axis; nothing if there is none."""
    return next(((point.x, point.y) for point in reversed(line) if point.y), ())


def points(line: Series) -> list[Point]:
    """Return the points in the order of x, so that a line never runs back."""
    nothing: list[float | None] = [None] * len(line.x)
    columns = [map(finite_or_none, values) for values in (line.y, line.low or nothing, line.high or nothing)]
    return sorted((Point(*values) for values in zip(line.x, *columns, strict=True)), key=lambda point: point.x)


def _traces(
    name: str, pen: Pen, line: list[Point], foot: float | None, top: float, few: bool
) -> tuple[list[Trace], ...]:
    """Return the band, or bars unless there are `few` lines, the line in parts if there are gaps, and the markers."""

    def raised(value: float) -> float:
        return foot if foot is not None and value == 0 else value

    colour = pen.colour.light
    edges = [(x, raised(low), raised(high)) for x, _, low, high in line if low is not None and high is not None]
    bands = []
    if edges:
        x, low, high = zip(*edges, strict=True)
        bands.append(Trace(f"{name}: spread", colour, "band" if few else "bar", x, low, y_high=high))
    width = 2.0 if len(line) <= 2 * MARKED else 1.4
    strokes = []
    for _, part in groupby(line, key=lambda point: point.y is not None):
        known = [(point.x, raised(point.y)) for point in part if point.y is not None]
        if len(known) > 1:
            x, y = zip(*known, strict=True)
            strokes.append(Trace(name, colour, "line", x, y, dash=pen.dash, width=width))
    usual = [(point.x, point.y) for point in line if point.y is not None and (foot is None or point.y != 0)]
    usual = usual[:: 1 if len(usual) <= 2 * MARKED else -(-len(usual) // MARKED)]
    markers = []
    if usual:
        x, y = zip(*usual, strict=True)
        markers.append(Trace(f"{name}: points", colour, "mark", x, y, marker=pen.marker, hollow=pen.hollow))
    if foot is not None and (zeros := tuple(point.x for point in line if point.y == 0)):
        markers.append(Trace(f"{name}: zero", colour, "zero", zeros, (foot,) * len(zeros)))
    if lost := tuple(point.x for point in line if point.y is None):
        markers.append(Trace(f"{name}: not finite", colour, "cross", lost, (top,) * len(lost)))
    return bands, strokes, markers


def _description(title: str, group: list[Series], lines: list[list[Point]]) -> str:
    ends = []
    for series, line in zip(group, lines, strict=True):
        path = " to ".join(
            f"{'no finite figure' if point.y is None else of_any_size(point.y)} at {of_any_size(point.x)}"
            for point in (line[0], *line[1:][-1:])
        )
        lost = sum(point.y is None for point in line)
        ends.append(f"{series.name} {path}" + (f", {lost} of {len(line)} not finite" if lost else ""))
    return f"{title}: {group[0].y_label} against {group[0].x_label}. {'; '.join(ends)}."
