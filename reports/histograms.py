"""Density before and after the amplifier, and the amplifier's α and β over training."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from harness.records import CellRecord, Checkpoint
from reports.load import Records
from reports.palette import MUTED, colours_of
from reports.selection import Selection
from reports.trace_data import Panel, Scale, Trace
from reports.wording import count, counted

GOLDEN = (1 + 5**0.5) / 2
FOOT = 1e-5 / 1.6
"""Where the axis of shares begins: smaller ones are drawn on it, so that empty bins have a place."""


@dataclass(frozen=True)
class Mean:
    """Mean shares over seeds, of one method on one scene at one step."""

    edges: list[float]
    before: list[float]
    after: list[float]
    step: int
    seeds: int
    finished: bool
    """Else there is none of a finished run, and it is of others."""

    @property
    def words(self) -> str:
        return f"step {count(self.step)}, {counted(self.seeds, 'seed' if self.finished else 'unfinished seed')}"


def density_histograms(records: Records) -> list[Panel]:
    """A panel for each scene and method with an amplifier: mean over seeds, the last step that all of them have."""
    colours = colours_of(records.methods)
    amplified = amplified_methods(records)
    panels = []
    for scene in records.scenes:
        for method in amplified:
            mean = _mean_density(records.cells_of(scene, method))
            if mean is not None:
                whose = f"{scene}, {method}" if len(amplified) > 1 else scene
                panels.append(_panel(f"{whose}: {mean.words}", mean, colours[method].light, Selection(scene, method)))
    most = min(max((share for panel in panels for trace in panel.traces for share in trace.y), default=1.0), 1.0)
    return [replace(panel, y_limits=(FOOT, 1.6 * most)) for panel in panels]


def amplified_methods(records: Records) -> list[str]:
    """Methods whose density is changed on its way to the picture."""
    found = {cell.method for cell in records.cells if any(map(_amplifies, cell.curve))}
    return [method for method in records.methods if method in found]


def _amplifies(point: Checkpoint) -> bool:
    density = point.density
    if not density or not _is_histogram(density):
        return False
    return point.alpha is not None or density["before"] != density["after"]


def _mean_density(cells: list[CellRecord]) -> Mean | None:
    """Over finished runs, or where there is none over the others."""
    finished = [cell for cell in cells if cell.status == "done"]
    return _mean_of(finished, True) or _mean_of([cell for cell in cells if cell not in finished], False)


def _mean_of(cells: list[CellRecord], finished: bool) -> Mean | None:
    """At the step, and with the bins, that most runs share, and of these at the last step: a run that ended early is
    not mixed with others that went on.
    """
    found: dict[tuple[int, tuple[float, ...]], list[dict[str, list[float]]]] = {}
    for point in (point for cell in cells for point in cell.curve):
        if point.density and _is_histogram(point.density):
            found.setdefault((point.step, tuple(point.density["edges"])), []).append(point.density)
    if not found:
        return None
    step, edges = max(found, key=lambda key: (len(found[key]), key[0]))
    alike = found[step, edges]
    before, after = (
        [sum(shares) / len(alike) for shares in zip(*(one[side] for one in alike), strict=True)]
        for side in ("before", "after")
    )
    return Mean(list(edges), before, after, step, len(alike), finished)


def _is_histogram(one: dict[str, list[float]]) -> bool:
    if not {"edges", "before", "after"} <= set(one):
        return False
    bins = len(one["edges"]) - 1
    return bins > 0 and len(one["before"]) == bins == len(one["after"])


def _panel(title: str, mean: Mean, colour: str, behind: Selection) -> Panel:
    edges = mean.edges
    scale, linear_below = axis_of(edges)
    traces = tuple(
        Trace(
            side,
            tone,
            "bins",
            tuple(edges[:-1]),
            tuple(shares),
            x_high=tuple(edges[1:]),
            runs=(behind,),
        )
        for side, tone, shares in (
            ("before the amplifier", MUTED.light, mean.before),
            ("after the amplifier", colour, mean.after),
        )
    )
    alt = f"{title}: share of points by density, before and after the amplifier. {_shift(mean)}"
    limits = (edges[0], edges[-1])
    return Panel(title, "density σ", "share of points", traces, alt, scale, "log", limits, linear_below=linear_below)


def axis_of(edges: Sequence[float]) -> tuple[Scale, float]:
    """Linear for evenly wide bins, otherwise logarithmic, through zero where the bins reach it."""
    widths = [high - low for low, high in pairwise(edges)]
    if max(widths) < 3 * min(widths):
        return "linear", 1.0
    if edges[0] > 0:
        return "log", 1.0
    return "symlog", min(abs(edge) for edge in edges if edge != 0)


def _shift(mean: Mean) -> str:
    """The means of both histograms, from the bins' middles."""
    middles = [(low + high) / 2 for low, high in pairwise(mean.edges)]
    means = [
        sum(middle * share for middle, share in zip(middles, shares, strict=True))
        for shares in (mean.before, mean.after)
    ]
    return f"Mean about {means[0]:.3g} before and {means[1]:.3g} after."


def amplifier_over_time(records: Records) -> list[Panel]:
    """α and β against steps: one line a cell, dashed where they started (1/φ and 1)."""
    colours = colours_of(records.methods)
    panels = []
    for name, letter, start in (("alpha", "α", 1 / GOLDEN), ("beta", "β", 1.0)):
        traces = []
        for cell in records.cells:
            x, y = _finite_pairs(cell.trace.get("step", []), cell.trace.get(name, []))
            if len(x) > 1:
                label = f"{cell.method} {cell.scene} seed {cell.seed}"
                behind = (Selection(cell.scene, cell.method, seed=cell.seed),)
                traces.append(Trace(label, colours[cell.method].light, "thin", x, y, runs=behind))
        if traces:
            ends = [trace.y[-1] for trace in traces]
            steps = [x for trace in traces for x in trace.x]
            traces.append(Trace("start", MUTED.light, "floor", (min(steps), max(steps)), (start, start)))
            alt = f"{letter} over training: starts at {start:.3f}, ends between {min(ends):.3f} and {max(ends):.3f}."
            panels.append(Panel(f"{letter} over training", "training step", letter, tuple(traces), alt))
    return panels


def _finite_pairs(
    xs: Sequence[float | None], ys: Sequence[float | None]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    pairs = [(float(x), float(y)) for x, y in zip(xs, ys, strict=False) if x is not None and y is not None]
    return tuple(x for x, _ in pairs), tuple(y for _, y in pairs)
