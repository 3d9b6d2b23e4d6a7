"""Series of a record → charts: one per panel, a band if the spread is known, colour, marker and dash by name.

Nothing is dropped silently: a zero on a logarithmic axis stands at its foot, a non-finite value at the upper edge.
"""

import math
from dataclasses import dataclass, replace
from itertools import groupby

from markupsafe import Markup

from harness.records.study import Series
from reports.data.wording import of_any_size
from reports.drawing.figure import padded, svg
from reports.drawing.palette import Pen, key, pens_of
from reports.drawing.traces import Panel, Trace

SIZE = (4.3, 2.9)
WIDE = (5.8, 3.6)
MANY_LINES = 5
"""The number of lines above which a chart is drawn wide."""
MARKED = 14
"""The number of points of a line up to which all are marked."""
FOOT = 10.0
"""The factor by which the foot of a logarithmic axis lies below the smallest positive value."""


@dataclass(frozen=True)
class Point:
    x: float
    y: float | None
    """The value; None if it was not finite."""
    low: float | None
    high: float | None


@dataclass(frozen=True)
class Chart:
    title: str
    keys: list[tuple[str, Markup]]
    """The name and a sample of each line."""
    svg: Markup
    notes: list[str]
    """The meaning of its special marks, if there are any."""
    wide: bool = False


def charts(series: list[Series], prefix: str) -> list[Chart]:
    """Charts in the order of their first series; a panel without points is left out.

    `prefix` makes ids unique in a page.
    """
    drawn = with_points(series)
    pens = pens_in(drawn)
    found = []
    for place, (title, group) in enumerate(panels_of(drawn)):
        keys = [(name, key(pens[name])) for name in dict.fromkeys(one.name for one in group)]
        made = panel(title, group, pens)
        found.append(Chart(title, keys, svg(made, f"{prefix}-{place}"), notes(made), made.size == WIDE))
    return found


def with_points(series: list[Series]) -> list[Series]:
    return [one for one in series if one.x]


def panels_of(drawn: list[Series]) -> list[tuple[str, list[Series]]]:
    """Return title and lines of each chart, in the order of their first series."""
    return [
        (title, [one for one in drawn if one.panel == title]) for title in dict.fromkeys(one.panel for one in drawn)
    ]


def pens_in(drawn: list[Series]) -> dict[str, Pen]:
    """Map name → pen, the same in every chart of these."""
    return pens_of(*([one.name for one in group] for _, group in panels_of(drawn)))


def panel(title: str, group: list[Series], pens: dict[str, Pen]) -> Panel:
    """Draw bands below, then lines, then markers, so that a single point is seen as well."""
    lines = [(one.name, pens[one.name], points(one)) for one in group]
    every = [point for _, _, line in lines for point in line]
    all_x = [point.x for point in every]
    all_y = [value for point in every for value in (point.y, point.low, point.high) if value is not None]
    log_x = all(one.log_x for one in group) and min(all_x) > 0
    log_y = all(one.log_y for one in group) and bool(all_y) and min(all_y) >= 0 and max(all_y) > 0
    foot = min((value for value in all_y if value > 0), default=1.0) / FOOT if log_y and min(all_y) == 0 else None
    limits = padded([foot, *filter(None, all_y)] if foot is not None else all_y, log_y)
    top = limits[1] if limits else 1.0
    traces = [trace for name, pen, line in lines for trace in _bands(name, pen, line, foot)]
    traces += [trace for name, pen, line in lines for trace in _strokes(name, pen, line, foot)]
    traces += [trace for name, pen, line in lines for trace in _markers(name, pen, line, foot, top)]
    return Panel(
        title,
        group[0].x_label,
        group[0].y_label,
        tuple(traces),
        description(title, group),
        "log" if log_x else "linear",
        "log" if log_y else "linear",
        padded(all_x, log_x),
        limits,
        size=WIDE if len(group) > MANY_LINES else SIZE,
        zero_at=foot,
    )


def points(one: Series) -> list[Point]:
    """Return points in the order of x: a line never runs back."""
    nothing: list[float | None] = [None] * len(one.x)
    columns = [map(finite, values) for values in (one.y, one.low or nothing, one.high or nothing)]
    return sorted((Point(*values) for values in zip(one.x, *columns, strict=True)), key=lambda point: point.x)


def finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _raised(value: float, foot: float | None) -> float:
    """Raise a zero to the foot of its logarithmic axis."""
    return foot if foot is not None and value == 0 else value


def _bands(name: str, pen: Pen, line: list[Point], foot: float | None) -> list[Trace]:
    known = [(p.x, p.low, p.high) for p in line if p.low is not None and p.high is not None]
    if not known:
        return []
    x, low, high = zip(*((x, _raised(low, foot), _raised(high, foot)) for x, low, high in known), strict=True)
    return [Trace(f"{name}: spread", pen.colour.light, "band", x, low, y_high=high)]


def _strokes(name: str, pen: Pen, line: list[Point], foot: float | None) -> list[Trace]:
    """Return the line, in parts if there are gaps."""
    width = 2.0 if len(line) <= 2 * MARKED else 1.4
    found = []
    for known, group in groupby(line, key=lambda point: point.y is not None):
        part = [(point.x, _raised(point.y, foot)) for point in group if point.y is not None]
        if known and len(part) > 1:
            x, y = zip(*part, strict=True)
            found.append(Trace(name, pen.colour.light, "line", x, y, dash=pen.dash, width=width))
    return found


def _markers(name: str, pen: Pen, line: list[Point], foot: float | None, top: float) -> list[Trace]:
    colour = pen.colour.light
    usual = [(point.x, point.y) for point in line if point.y is not None and (foot is None or point.y != 0)]
    usual = usual[:: 1 if len(usual) <= 2 * MARKED else -(-len(usual) // MARKED)]
    zeros = [(point.x, foot) for point in line if foot is not None and point.y == 0]
    lost = [(point.x, top) for point in line if point.y is None]
    kinds = [
        (usual, Trace(f"{name}: points", colour, "mark", (), (), marker=pen.marker, hollow=pen.hollow)),
        (zeros, Trace(f"{name}: zero", colour, "zero", (), ())),
        (lost, Trace(f"{name}: not finite", colour, "cross", (), ())),
    ]
    return [replace(trace, x=tuple(x for x, _ in at), y=tuple(y for _, y in at)) for at, trace in kinds if at]


def notes(made: Panel) -> list[str]:
    """Return `▽ exactly 0`, `✕ not a finite number`, if they occur."""
    kinds = {trace.kind for trace in made.traces}
    words = {"zero": "▽ exactly 0, drawn at the foot of the axis", "cross": "✕ not a finite number"}
    return [said for kind, said in words.items() if kind in kinds]


def description(title: str, group: list[Series]) -> str:
    """Describe the chart for those who do not see it: where each line begins and ends."""
    ends = []
    for one in group:
        line = points(one)
        path = " to ".join(map(_at, [line[0], *line[1:][-1:]]))
        lost = sum(point.y is None for point in line)
        ends.append(f"{one.name} {path}" + (f", {lost} of {len(line)} not finite" if lost else ""))
    return f"{title}: {group[0].y_label} against {group[0].x_label}. {'; '.join(ends)}."


def _at(point: Point) -> str:
    return f"{'no finite figure' if point.y is None else of_any_size(point.y)} at {of_any_size(point.x)}"
