"""The numbers of a drawing, embedded beside it: what a reader points at, and what is saved as CSV.

    {"title", "box": [x, y, width, height] of the axes in the drawing's own units,
     "x": {"label", "scale", "low", "high"}, "y": likewise with "rows", their names,
     "traces": [{"label", "kind", "colour", "x", "y", "x_high", "y_high", "runs", "steps"}], "runs": [Selection, …]}

`x` is the place of an earlier trace where it is the same, `runs` are places in the drawing's list of runs: one, or
one a point. Numbers have six significant digits.
"""

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from markupsafe import Markup
from matplotlib.axes import Axes

from reports import palette
from reports.script import as_data
from reports.selection import Selection

if TYPE_CHECKING:
    from reports.figure import Panel, Trace

POINTS_AN_INCH = 72.0
OUTLINES = ("area",)
"""Kinds that are drawn around points of other traces, and hold no numbers of their own."""


def as_element(panel: "Panel", axes: Axes) -> Markup:
    """For the place behind the drawing; nothing in it can run or end the element."""
    return Markup('<script type="application/json" class="drawn">{}</script>').format(as_data(data_of(panel, axes)))


def data_of(panel: "Panel", axes: Axes) -> dict[str, Any]:
    """What the page's script knows of a drawing whose axes have been painted."""
    width, height = (POINTS_AN_INCH * inches for inches in panel.size)
    left, bottom, wide, high = axes.get_position().bounds
    runs = list(dict.fromkeys(one for trace in panel.traces for one in trace.runs))
    traces = [trace for trace in panel.traces if trace.kind not in OUTLINES]
    y = _axis(panel.y_label, panel.y_scale, axes.get_ylim(), panel.linear_below)
    found: dict[str, Any] = {
        "title": panel.title,
        "box": rounded((left * width, (1 - bottom - high) * height, wide * width, high * height)),
        "x": _axis(panel.x_label, panel.x_scale, axes.get_xlim(), panel.linear_below),
        "y": y | ({"rows": list(panel.rows)} if panel.rows else {}),
        "traces": [_trace(trace, traces[:place], runs) for place, trace in enumerate(traces)],
    }
    return found | ({"runs": [one.data() for one in runs]} if runs else {})


def _axis(label: str, scale: str, limits: tuple[float, float], linear_below: float) -> dict[str, Any]:
    low, high = rounded(limits)
    further = {"linear_below": linear_below} if scale == "symlog" else {}
    return {"label": label, "scale": scale, "low": low, "high": high} | further


def _trace(trace: "Trace", earlier: list["Trace"], runs: list[Selection]) -> dict[str, Any]:
    same = next((place for place, one in enumerate(earlier) if one.x == trace.x), None)
    found: dict[str, Any] = {
        "label": trace.label,
        "kind": trace.kind,
        "colour": _variable(trace.colour),
        "x": rounded(trace.x) if same is None else same,
        "y": rounded(trace.y),
    }
    for name in ("x_high", "y_high"):
        if getattr(trace, name):
            found[name] = rounded(getattr(trace, name))
    if trace.runs:
        found["runs"] = [runs.index(one) for one in trace.runs]
    if trace.steps:
        found["steps"] = list(trace.steps)
    return found


def _variable(colour: str) -> str:
    return next((one.variable for one in palette.EVERY if one.light == colour), "--ink")


def rounded(values: Iterable[float]) -> list[float | int | None]:
    """Six significant digits; None for what is not finite."""
    return [_rounded(float(value)) for value in values]


def _rounded(value: float) -> float | int | None:
    if not math.isfinite(value):
        return None
    short = float(f"{value:.6g}")
    return int(short) if short.is_integer() and abs(short) < 1e15 else short
