"""Plain trace data → inline SVG. Other modules return plots as data; only this module draws.

Text stays text (searchable, in the reader's font), colours become CSS variables (light and dark mode),
and every id is made unique, so that many figures can live in one page.
"""

import io
import math
import re
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import matplotlib
from markupsafe import Markup, escape
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from reports.data.wording import MINUS, scientific, significant
from reports.drawing import palette
from reports.drawing.palette import INK
from reports.drawing.traces import Kind, Panel, Trace, as_element


def inline_svg(text: str, name: str, alt: str, labels: Sequence[str] = ()) -> str:
    """Change an SVG of Matplotlib so that it can share a page with others; the ids `line-0`, … and `end-0`, … become
    `data-line` and `data-end` with the name among `labels`.
    """
    body = text[text.index("<svg") :]
    view, *_ = re.findall(r'viewBox="([^"]+)"', body)
    inner = body[body.index(">") + 1 : body.rindex("</svg>")]
    inner = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", inner, flags=re.DOTALL)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', inner))

    def named(tag: re.Match[str]) -> str:
        words = re.sub(r' id="(line|end)-(\d+)"', lambda of: f' data-{of[1]}="{escape(labels[int(of[2])])}"', tag[0])
        words = re.sub(r' id="axis-([xy])"', r' data-axis="\1"', words)
        return re.sub(r' id="([^"]+)"', lambda id: f' id="{name}-{id[1]}"' if id[1] in used else "", words)

    inner = re.sub(r"<[^>]+>", named, inner)  # a text may look like an attribute
    inner = re.sub(r'(xlink:href="#|url\(#)', lambda use: f"{use[1].removeprefix('xlink:')}{name}-", inner)
    inner = re.sub(r"font-family: [^;\"]+;? ?", "", inner)
    inner = re.sub(r" transform=\"rotate\(-0 [^\"]+\"", "", inner)
    inner = re.sub(r'="[^"]*"', lambda value: re.sub(r"(\d\.\d\d)\d+", r"\1", value[0]), inner)
    inner = re.sub(r"\s*\n\s*", " ", inner)
    for colour in palette.EVERY:
        inner = inner.replace(colour.light, f"var({colour.variable})")
    return f'<svg class="plot" viewBox="{view}" role="img" aria-label="{escape(alt)}">{inner}</svg>'


FINEST = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""The labelled multiples of a power of ten on a short logarithmic axis."""
DRAWABLE = 1e150
"""The end of the axes; logarithmic axes begin at its reciprocal. Far beyond, ticks are not finite."""

NAME_POINTS = 10.5
"""The height in points of a name at the end of a line."""

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "reports",
    "text.parse_math": False,
    "font.size": 9.0,
    "font.family": "DejaVu Sans",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.edgecolor": palette.MUTED.light,
    "axes.labelcolor": palette.MUTED.light,
    "axes.labelpad": 5.0,
    "xtick.color": palette.MUTED.light,
    "ytick.color": palette.MUTED.light,
    "xtick.major.size": 3.0,
    "ytick.major.size": 0.0,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": palette.RULE.light,
    "grid.linewidth": 0.8,
}


def with_common_limits(panels: list[Panel], axes: str = "xy") -> list[Panel]:
    """Set the same limits on every panel, so that panels can be compared by eye."""
    for axis in axes:
        traces = [trace for panel in panels for trace in panel.traces]
        values = [v for trace in traces for v in (*getattr(trace, axis), *getattr(trace, f"{axis}_high"))]
        values = [value for value in values if not math.isnan(value)]
        if values:
            log = getattr(panels[0], f"{axis}_scale") == "log"
            limits = padded([v for v in values if v > 0] if log else values, log)
            panels = [
                replace(panel, x_limits=limits) if axis == "x" else replace(panel, y_limits=limits) for panel in panels
            ]
    return panels


def _drawable(limits: tuple[float, float]) -> tuple[float, float]:
    low, high = (min(max(end, -DRAWABLE), DRAWABLE) for end in limits)
    return low, high


def padded(values: list[float], log: bool) -> tuple[float, float] | None:
    """Widen the range of the values a little, within `DRAWABLE`; points beyond are not visible."""
    if not values:
        return None
    low, high = _drawable((min(values), max(values)))
    if log:
        low, high = max(low, 1 / DRAWABLE), max(high, 1 / DRAWABLE)
        ratio = high**0.05 / low**0.05 if high > low else 1.5
        return low / ratio, high * ratio
    margin = 0.05 * (high - low) or 0.5
    return low - margin, high + margin


def draw(panel: Panel) -> Figure:
    """Draw one panel; pass the figure to `svg` or save it as PNG."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=panel.size)
        longest = max((len(line) for row in panel.rows for line in row.splitlines()), default=0)
        left = max(0.9, 0.25 + 0.068 * min(longest, 40)) if panel.rows else 0.62 if panel.labelled else 0.42
        right = 0.12 + 0.062 * max(map(len, panel.figures), default=0)
        right += 0.1 + 0.075 * max(len(name) for name, *_ in panel.ends) if panel.ends else 0.0
        width, height = panel.size
        bottom, above = (0.12, 0.42) if panel.columns else (0.5 if panel.labelled else 0.25, 0.12)
        axes = figure.add_axes(
            (left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + above) / height), facecolor="none"
        )
        figure.patch.set_visible(False)
        paint(axes, panel)
        return figure


def paint(axes: Axes, panel: Panel) -> None:
    for name in "xy":
        if (limits := getattr(panel, f"{name}_limits")) is not None:
            # first: otherwise Matplotlib derives limits from all numbers, however large
            getattr(axes, f"set_{name}lim")(*_drawable(limits))
    for place, trace in enumerate(panel.traces):
        drawn = _PENS[trace.kind](axes, trace)
        for artist in drawn if isinstance(drawn, list) else [drawn]:
            artist.set_gid(f"line-{place}")
    axes.xaxis.set_gid("axis-x")
    axes.yaxis.set_gid("axis-y")
    _axis(axes, panel, "x")
    _axis(axes, panel, "y")
    if panel.rows:
        axes.set_ylim(len(panel.rows) - 0.5, -0.5)
        axes.yaxis.set_major_locator(FixedLocator(range(len(panel.rows))))
        axes.yaxis.set_major_formatter(FuncFormatter(lambda at, _: panel.rows[round(at)]))
        axes.yaxis.set_minor_locator(NullLocator())
    for place, words in enumerate(panel.figures):
        axes.text(1.02, place, words, transform=axes.get_yaxis_transform(), va="center", fontsize=8, color=INK.light)
    _name_ends(axes, panel)
    if panel.columns:
        axes.xaxis.tick_top()
        axes.spines[:].set_visible(False)
        axes.grid(visible=False)
        axes.tick_params(length=0)
        axes.set_xticks([at for at, _ in panel.columns], [words for _, words in panel.columns], ha="left")
    if panel.zero_at is not None:
        foot = panel.zero_at
        above = [at for at in axes.yaxis.get_majorticklocs() if at > foot * 1.01]
        axes.yaxis.set_major_locator(FixedLocator([foot, *above]))
        write = axes.yaxis.get_major_formatter()
        axes.yaxis.set_major_formatter(FuncFormatter(lambda at, _: "0" if at == foot else write(at)))
        axes.axhline(foot, color=palette.MUTED.light, linewidth=0.8, linestyle=(0, (1, 2)), zorder=1)


def _name_ends(axes: Axes, panel: Panel) -> None:
    """Name each line to the right of its last point; names that would overlap move apart."""
    height = 72.0 * panel.size[1] * axes.get_position().height
    to_axes = axes.transData + axes.transAxes.inverted()
    placed = sorted((float(to_axes.transform((x, y))[1]) * height, *end) for end in panel.ends for _, _, x, y in [end])
    at = spread([place for place, *_ in placed], NAME_POINTS)
    for up, (_, name, colour, x, y) in zip(at, placed, strict=True):
        named = axes.annotate(
            name, (x, y), (1.02, up / height), textcoords="axes fraction", va="center", fontsize=8.5, color=colour,
            annotation_clip=False, arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.6, "alpha": 0.6},
        )  # fmt: skip
        for artist in filter(None, (named, named.arrow_patch)):
            artist.set_gid(f"end-{len(panel.traces) + [end[0] for end in panel.ends].index(name)}")


def spread(places: list[float], gap: float) -> list[float]:
    """Move ascending places apart until neighbours are `gap` apart, each group about its own middle."""
    groups: list[tuple[float, int]] = []  # middle and number of places
    for place in places:
        middle, many = place, 1
        while groups and middle - groups[-1][0] < gap * (many + groups[-1][1]) / 2:
            below, count = groups.pop()
            middle, many = (middle * many + below * count) / (many + count), many + count
        groups.append((middle, many))
    return [middle + gap * (at - (many - 1) / 2) for middle, many in groups for at in range(many)]


def _axis(axes: Axes, panel: Panel, name: str) -> None:
    scale, write = getattr(panel, f"{name}_scale"), tick
    axis = getattr(axes, f"{name}axis")
    getattr(axes, f"set_{name}label")(getattr(panel, f"{name}_label") if panel.labelled else "")
    if scale != "linear":
        getattr(axes, f"set_{name}scale")(scale, **({"linthresh": panel.linear_below} if scale == "symlog" else {}))
    if scale == "linear":
        axis.set_major_locator(MaxNLocator(5))
    elif scale == "log":
        low, high = getattr(axes, f"get_{name}lim")()
        decades = math.log10(high) - math.log10(low)
        subdivisions = (1.0,) if decades > 1.7 else (1.0, 2.0, 5.0) if decades > 0.6 else FINEST
        axis.set_major_locator(LogLocator(subs=subdivisions, numticks=8))
        write = power if decades > 6.0 else tick
    axis.set_minor_formatter(NullFormatter())
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda at, _: write(at)))


def tick(value: float) -> str:
    """Return a short label: 0.05, 20, 5k, 2M."""
    if abs(value) >= 1e18:
        return scientific(value, 1)
    for size, letter in ((1e15, "P"), (1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return f"{value / size:g}{letter}".replace("-", MINUS)
    if value != 0 and abs(value) < 1e-3:
        return significant(value, 1)
    return f"{value:.4g}".replace("-", MINUS)


def power(value: float) -> str:
    """Return a label if the axis spans many powers of ten: 10⁻⁸, 1, 10⁴."""
    return "1" if value == 1 else scientific(value, 1) if value > 0 else tick(value)


Drawn = Artist | list[Line2D]


def _line(axes: Axes, trace: Trace) -> Drawn:
    style = {"linestyle": (0, trace.dash)} if trace.dash else {"solid_capstyle": "round"}
    return axes.plot(trace.x, trace.y, color=trace.colour, linewidth=trace.width, **style)


def _bins(axes: Axes, trace: Trace) -> Drawn:
    """Draw bins; an empty bin has no place on a logarithmic axis and lies on its foot."""
    foot = axes.get_ylim()[0]
    edges = [*trace.x, trace.x_high[-1]]
    return axes.stairs([max(share, foot) for share in trace.y], edges, baseline=None, color=trace.colour, linewidth=1.4)


def _range(axes: Axes, trace: Trace) -> Drawn:
    return axes.hlines(trace.y, trace.x, trace.x_high, color=trace.colour, linewidth=2.0, alpha=0.75)


def _mark(axes: Axes, trace: Trace) -> Drawn:
    face = palette.PAPER.light if trace.hollow else trace.colour
    return axes.plot(trace.x, trace.y, trace.marker, mfc=face, mec=trace.colour, ms=trace.size, mew=1.2, zorder=3)


def _band(axes: Axes, trace: Trace) -> Drawn:
    """Draw a band; a single point has no width to fill and is drawn as a bar."""
    if len(trace.x) == 1:
        return axes.vlines(trace.x, trace.y, trace.y_high, color=trace.colour, linewidth=2.0, alpha=0.4)
    return axes.fill_between(trace.x, trace.y, trace.y_high, color=trace.colour, alpha=0.18, linewidth=0)


def _bar(axes: Axes, trace: Trace) -> Drawn:
    return axes.vlines(trace.x, trace.y, trace.y_high, color=trace.colour, linewidth=1.6, alpha=0.5)


def _area(axes: Axes, trace: Trace) -> Drawn:
    """Draw one path for all polygons, so that overlaps are filled once."""
    ends = [place for place, x in enumerate(trace.x) if math.isnan(x)]
    parts = zip([0, *(end + 1 for end in ends)], [*ends, len(trace.x)], strict=True)
    corners = [[*zip(trace.x[a:b], trace.y[a:b], strict=True), (trace.x[a], trace.y[a])] for a, b in parts]
    outline = Path.make_compound_path(*(Path(polygon, closed=True) for polygon in corners))
    return axes.add_patch(PathPatch(outline, facecolor=trace.colour, alpha=0.16, linewidth=0))


def _plotted(**style: Any) -> Callable[[Axes, Trace], Drawn]:
    return lambda axes, trace: axes.plot(trace.x, trace.y, color=trace.colour, **style)


_PENS: dict[Kind, Callable[[Axes, Trace], Drawn]] = {
    "line": _line,
    "thin": _plotted(linewidth=0.8, alpha=0.45),
    "dots": _plotted(marker="o", linestyle="", markersize=4.6, markeredgewidth=0),
    "cross": _plotted(marker="x", linestyle="", markersize=8, markeredgewidth=2.2, clip_on=False, zorder=5),
    "floor": _plotted(linewidth=1.1, linestyle=(0, (4, 3)), zorder=1),
    "outline": _plotted(linewidth=1.4, drawstyle="steps-post", solid_joinstyle="miter"),
    "zero": _plotted(marker="v", linestyle="", mfc=palette.PAPER.light, ms=6, mew=1.4, clip_on=False, zorder=4),
    "bins": _bins,
    "range": _range,
    "mark": _mark,
    "band": _band,
    "bar": _bar,
    "area": _area,
}


def svg(panel: Panel, name: str) -> Markup:
    """Return an `<svg>` followed by its numbers; `name`, of letters, digits and dashes, makes its ids unique."""
    buffer = io.StringIO()
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # text stays text: the reader's browser draws it
        drawn = draw(panel)
        drawn.savefig(buffer, format="svg", metadata={"Date": None})
    labels = [*(trace.label for trace in panel.traces), *(name for name, *_ in panel.ends)]
    return Markup(inline_svg(buffer.getvalue(), name, panel.alt, labels)) + as_element(panel, drawn.axes[0])


class Plot(NamedTuple):
    title: str
    svg: Markup


def plots(panels: Iterable[Panel], name: str) -> list[Plot]:
    """Return all plots; `name`, of letters, digits and dashes, makes their ids unique on the page."""
    return [Plot(panel.title, svg(panel, f"{name}-{place}")) for place, panel in enumerate(panels)]
