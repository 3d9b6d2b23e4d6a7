"""Density before and after the amplifier, and the amplifier's α and β over training."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from harness.records import CellRecord, Checkpoint
from reports.figure import Panel, Scale, Trace
from reports.load import Records
from reports.palette import MUTED, colours_of
from reports.selection import Selection

GOLDEN = (1 + 5**0.5) / 2
FOOT = 1e-5 / 1.6
"""Where the axis of shares begins: smaller ones are drawn on it, so that empty bins have a place."""


def density_histograms(records: Records) -> list[Panel]:
    """A panel for each scene and method with an amplifier: the last checkpoint, mean over seeds with the same bins."""
    colours = colours_of(records.methods)
    panels = []
    for scene in records.scenes:
        for method in records.methods:
            points = [point for cell in records.cells_of(scene, method) if (point := _last_with_density(cell))]
            density = _mean_density([point.density for point in points if point.density])
            if density is not None and (points[0].alpha is not None or density["before"] != density["after"]):
                several = len(amplified_methods(records)) > 1
                title = f"{scene}, {method}" if several else scene
                panels.append(_panel(title, density, colours[method].light, Selection(scene, method)))
    most = min(max((share for panel in panels for trace in panel.traces for share in trace.y), default=1.0), 1.0)
    return [replace(panel, y_limits=(FOOT, 1.6 * most)) for panel in panels]


def amplified_methods(records: Records) -> list[str]:
    """Methods whose density is changed on its way to the picture."""
    found = set()
    for cell in records.cells:
        point = _last_with_density(cell)
        if point and point.density and (point.alpha is not None or point.density["before"] != point.density["after"]):
            found.add(cell.method)
    return [method for method in records.methods if method in found]


def _last_with_density(cell: CellRecord) -> Checkpoint | None:
    return next((point for point in reversed(cell.curve) if point.density), None)


def _mean_density(found: list[dict[str, list[float]]]) -> dict[str, list[float]] | None:
    """Mean shares over the seeds whose bins are the first one's."""
    sound = [one for one in found if _is_histogram(one)]
    if not sound:
        return None
    alike = [one for one in sound if one["edges"] == sound[0]["edges"]]
    means = {
        side: [sum(shares) / len(alike) for shares in zip(*(one[side] for one in alike), strict=True)]
        for side in ("before", "after")
    }
    return {"edges": sound[0]["edges"], **means}


def _is_histogram(one: dict[str, list[float]]) -> bool:
    if not {"edges", "before", "after"} <= set(one):
        return False
    bins = len(one["edges"]) - 1
    return bins > 0 and len(one["before"]) == bins == len(one["after"])


def _panel(title: str, density: dict[str, list[float]], colour: str, behind: Selection) -> Panel:
    edges = density["edges"]
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
            ("before the amplifier", MUTED.light, density["before"]),
            ("after the amplifier", colour, density["after"]),
        )
    )
    alt = f"{title}: share of points by density, before and after the amplifier. {_shift(density)}"
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


def _shift(density: dict[str, list[float]]) -> str:
    """The means of both histograms, from the bins' middles."""
    middles = [(low + high) / 2 for low, high in pairwise(density["edges"])]
    means = [
        sum(middle * share for middle, share in zip(middles, density[side], strict=True))
        for side in ("before", "after")
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
