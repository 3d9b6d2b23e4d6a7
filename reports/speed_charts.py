"""Series of a speed run → charts: one a panel, a band where the spread is known, colour and marker by name."""

from collections.abc import Iterable
from dataclasses import dataclass

from markupsafe import Markup

from harness.chart_record import Series
from reports import palette
from reports.figure import Panel, Trace, padded, svg
from reports.speed_wording import figure

SIZE = (4.3, 2.9)
ORDER = (*(palette.KNOWN[name] for name in ("nerf", "qnerf")), *palette.OTHERS)
"""Far apart for every kind of colour vision where there are few; methods keep their own colours."""


@dataclass(frozen=True)
class Pen:
    colour: palette.Colour
    hollow: bool
    """Every second name has hollow markers, so that colour is not all that tells them apart."""


@dataclass(frozen=True)
class Chart:
    title: str
    keys: list[tuple[str, Pen]]
    svg: Markup


def charts(series: list[Series], item: int) -> list[Chart]:
    """Charts of one question in the order of their first series; a panel without points is left out."""
    drawn = [one for one in series if one.item == item and one.x]
    pens = pens_of(one.name for one in drawn)
    found = []
    for place, title in enumerate(dict.fromkeys(one.panel for one in drawn)):
        group = [one for one in drawn if one.panel == title]
        names = dict.fromkeys(one.name for one in group)
        keys = [(name, pens[name]) for name in names]
        found.append(Chart(title, keys, svg(panel(title, group, pens), f"speed-{item}-{place}")))
    return found


def pens_of(names: Iterable[str]) -> dict[str, Pen]:
    """Name → pen, the same in every chart of a question."""
    unique = list(dict.fromkeys(names))
    kept = {name: palette.KNOWN[name] for name in unique if name in palette.KNOWN}
    free = [colour for colour in ORDER if colour not in kept.values()]
    others = [name for name in unique if name not in kept]
    colours = {**kept, **{name: free[place % len(free)] for place, name in enumerate(others)}}
    return {name: Pen(colours[name], place % 2 == 1) for place, name in enumerate(unique)}


def panel(title: str, group: list[Series], pens: dict[str, Pen]) -> Panel:
    """Bands below, then lines, then markers, so that a single point is seen as well."""
    sorted_group = [_sorted(one) for one in group]
    bands, lines, markers = [], [], []
    for one in sorted_group:
        colour = pens[one.name].colour.light
        x, y = tuple(one.x), tuple(one.y)
        if one.low is not None and one.high is not None:
            bands.append(Trace(f"{one.name}: spread", colour, "band", x, tuple(one.low), y_high=tuple(one.high)))
        if len(x) > 1:
            lines.append(Trace(one.name, colour, "line", x, y))
        markers.append(Trace(f"{one.name}: points", colour, "mark" if pens[one.name].hollow else "dots", x, y))
    traces = (*bands, *lines, *markers)
    all_x = [value for trace in traces for value in trace.x]
    all_y = [value for trace in traces for value in (*trace.y, *trace.y_high)]
    log_x = all(one.log_x for one in group) and min(all_x) > 0
    log_y = all(one.log_y for one in group) and min(all_y) > 0
    return Panel(
        title,
        group[0].x_label,
        group[0].y_label,
        traces,
        description(title, sorted_group),
        "log" if log_x else "linear",
        "log" if log_y else "linear",
        padded(all_x, log_x),
        padded(all_y, log_y),
        size=SIZE,
    )


def description(title: str, group: list[Series]) -> str:
    """The chart for those who do not see it: where each line begins and ends."""
    ends = []
    for one in group:
        path = f"{figure(one.y[0])} at {figure(one.x[0])}"
        if len(one.x) > 1:
            path += f" to {figure(one.y[-1])} at {figure(one.x[-1])}"
        ends.append(f"{one.name} {path}")
    return f"{title}: {group[0].y_label} against {group[0].x_label}. {'; '.join(ends)}."


def _sorted(one: Series) -> Series:
    """By x: a line never runs back."""
    order = sorted(range(len(one.x)), key=one.x.__getitem__)

    def put(values: list[float]) -> list[float]:
        return [values[place] for place in order]

    return Series(
        **{
            **one.__dict__,
            "x": put(one.x),
            "y": put(one.y),
            "low": None if one.low is None else put(one.low),
            "high": None if one.high is None else put(one.high),
        }
    )
