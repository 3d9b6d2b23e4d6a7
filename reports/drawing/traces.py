"""The numbers of a drawing: plain traces on panels, and JSON next to the SVG for pointing at values and saving CSV.

    {"title", "box": [x, y, width, height] of the axes in the drawing's own units,
     "x": {"label", "scale", "low", "high"}, "y": likewise with "rows", their names,
     "traces": [{"label", "kind", "colour", "x", "y", "x_high", "y_high", "runs", "steps"}], "runs": [Selection, …]}

`x` is the index of an earlier trace with the same x; `runs` are indices into the drawing's list of runs, one for the
trace or one per point. Numbers have six significant digits.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

from markupsafe import Markup
from matplotlib.axes import Axes

from reports.data.packing import as_data
from reports.data.selection import Selection
from reports.drawing import palette

Kind = Literal[
    "line", "thin", "dots", "cross", "floor", "outline", "bins", "range", "mark", "zero", "band", "bar", "area"
]  # fmt: skip
Scale = Literal["linear", "log", "symlog"]


@dataclass(frozen=True)
class Trace:
    """Points of one kind and colour; `x` and `y` have the same length.

    `bins` and the bars of a `range` reach from `x` to `x_high`, a `band` lies between `y` and `y_high`, as a `bar` at
    each point does, an `area` is the union of polygons of the same orientation, separated by NaN. A `line` may be
    dashed, a `mark` has a shape (Matplotlib's letter), a `zero` is drawn at the foot of a logarithmic axis.
    """

    label: str
    colour: str
    kind: Kind
    x: tuple[float, ...]
    y: tuple[float, ...]
    x_high: tuple[float, ...] = ()
    y_high: tuple[float, ...] = ()
    dash: tuple[float, ...] = ()
    width: float = 2.0
    marker: str = "D"
    hollow: bool = True
    size: float = 4.6
    runs: tuple[Selection, ...] = field(default=(), compare=False)
    """The runs behind it: one for the complete trace, or one per point."""
    steps: tuple[int, ...] = field(default=(), compare=False)
    """The training step of each point, if it has one."""


@dataclass(frozen=True)
class Panel:
    """One set of axes. `rows` names whole numbers on the y axis, the first on top."""

    title: str
    x_label: str
    y_label: str
    traces: tuple[Trace, ...]
    alt: str
    x_scale: Scale = "linear"
    y_scale: Scale = "linear"
    x_limits: tuple[float, float] | None = None
    y_limits: tuple[float, float] | None = None
    rows: tuple[str, ...] = ()
    figures: tuple[str, ...] = ()
    """The text to the right of each row."""
    ends: tuple[tuple[str, str, float, float], ...] = ()
    """The name, the colour and the last point of each line that is named there instead of only in a key."""
    columns: tuple[tuple[float, str], ...] = ()
    """Positions on the x axis with text above them, in place of its ticks."""
    size: tuple[float, float] = (3.7, 2.6)
    labelled: bool = True
    """Whether the axes carry their labels; small multiples share those of their first panel."""
    linear_below: float = 1.0
    """The value at which a `symlog` axis begins to be logarithmic."""
    zero_at: float | None = None
    """The position of zeros on a logarithmic y axis; its tick is labelled 0."""


def as_element(panel: Panel, axes: Axes) -> Markup:
    """Return the element that follows the drawing; nothing in it can run or end the element."""
    return Markup('<script type="application/json" class="drawn">{}</script>').format(as_data(data_of(panel, axes)))


def data_of(panel: Panel, axes: Axes) -> dict[str, object]:
    width, height = (72.0 * inches for inches in panel.size)  # in points
    left, bottom, wide, high = axes.get_position().bounds
    runs = list(dict.fromkeys(selection for trace in panel.traces for selection in trace.runs))
    traces = [trace for trace in panel.traces if trace.kind != "area"]  # drawn around points of other traces
    y = _axis(panel.y_label, panel.y_scale, axes.get_ylim(), panel.linear_below)
    data: dict[str, object] = {
        "title": panel.title,
        "box": rounded((left * width, (1 - bottom - high) * height, wide * width, high * height)),
        "x": _axis(panel.x_label, panel.x_scale, axes.get_xlim(), panel.linear_below),
        "y": y | ({"rows": list(panel.rows)} if panel.rows else {}),
        "traces": [_trace(trace, traces[:place], runs) for place, trace in enumerate(traces)],
    }
    return data | ({"runs": [selection.data() for selection in runs]} if runs else {})


def _axis(label: str, scale: str, limits: tuple[float, float], linear_below: float) -> dict[str, object]:
    low, high = rounded(limits)
    data: dict[str, object] = {"label": label, "scale": scale, "low": low, "high": high}
    return data | ({"linear_below": linear_below} if scale == "symlog" else {})


def _trace(trace: Trace, earlier: list[Trace], runs: list[Selection]) -> dict[str, object]:
    same = next((place for place, before in enumerate(earlier) if before.x == trace.x), None)
    data: dict[str, object] = {
        "label": trace.label,
        "kind": trace.kind,
        "colour": next((colour.variable for colour in palette.EVERY if colour.light == trace.colour), "--ink"),
        "x": rounded(trace.x) if same is None else same,
        "y": rounded(trace.y),
    }
    for name in ("x_high", "y_high"):
        if getattr(trace, name):
            data[name] = rounded(getattr(trace, name))
    if trace.runs:
        data["runs"] = [runs.index(selection) for selection in trace.runs]
    if trace.steps:
        data["steps"] = list(trace.steps)
    return data


def rounded(values: Iterable[float]) -> list[float | int | None]:
    """Round to six significant digits; None for a non-finite number."""
    short = [float(f"{value:.6g}") if math.isfinite(value) else None for value in values]
    return [int(each) if each is not None and each.is_integer() and abs(each) < 1e15 else each for each in short]
