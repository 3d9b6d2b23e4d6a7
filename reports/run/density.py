"""Histograms of density before and after the amplifier, and the further methods that explain a result on one scene."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from statistics import fmean, stdev
from typing import NamedTuple

import numpy as np

from harness.records.cells import CellRecord, Checkpoint
from harness.records.verdict import phrase_with
from reports.data.load import Records
from reports.data.selection import Selection
from reports.data.wording import NARROW, count, counted, interval, number, signed
from reports.drawing.palette import MUTED, colours_of
from reports.drawing.traces import Panel, Scale, Trace
from reports.page.grid import EMPTY, Column, Entry, Grid

GOLDEN = (1 + 5**0.5) / 2
FOOT = 1e-5 / 1.6
"""The lower end of the axis of shares; smaller shares and empty bins are drawn there."""
SIDES = ("before", "after")


class Mean(NamedTuple):
    edges: tuple[float, ...]
    shares: dict[str, tuple[float, ...]]
    step: int
    seeds: int


def is_histogram(point: Checkpoint) -> bool:
    density = point.density or {}
    bins = len(density.get("edges", ())) - 1
    return bins > 0 and all(len(density.get(side, ())) == bins for side in SIDES)


def density_histograms(records: Records) -> list[Panel]:
    """Draw a panel for each scene and method with an amplifier: the mean over the finished runs, else over all."""
    amplified = amplified_methods(records)
    panels = []
    for scene in records.scenes:
        for method in amplified:
            cells = records.cells_of(scene, method)
            finished = mean_density([cell for cell in cells if cell.status == "done"])
            mean = finished or mean_density(cells)
            if mean is None:
                continue
            whose = f"{scene}, {method}" if len(amplified) > 1 else scene
            seeds = counted(mean.seeds, "seed" if finished else "unfinished seed")
            title = f"{whose}: step {count(mean.step)}, {seeds}"
            panels.append(_histogram(title, mean, colours_of(records.methods)[method].light, Selection(scene, method)))
    most = max((share for panel in panels for trace in panel.traces for share in trace.y), default=1.0)
    return [replace(panel, y_limits=(FOOT, 1.6 * min(most, 1.0))) for panel in panels]


def amplified_methods(records: Records) -> list[str]:
    """Return the methods with an amplifier: the density of the picture is not that of the network."""

    def amplifies(point: Checkpoint) -> bool:
        density = point.density or {}
        return is_histogram(point) and (point.alpha is not None or density["before"] != density["after"])

    amplified = {cell.method for cell in records.cells if any(map(amplifies, cell.curve))}
    return [method for method in records.methods if method in amplified]


def mean_density(cells: list[CellRecord]) -> Mean | None:
    """Average over the runs that have the most common step and bins: none that ended early with later checkpoints."""
    densities = [(point.step, point.density or {}) for cell in cells for point in cell.curve if is_histogram(point)]
    keyed = [((step, tuple(density["edges"])), density) for step, density in densities]
    if not keyed:
        return None
    many = Counter(key for key, _ in keyed)
    step, edges = max(many, key=lambda key: (many[key], key[0]))
    alike = [density for key, density in keyed if key == (step, edges)]
    means = {side: tuple(map(float, np.mean([density[side] for density in alike], axis=0))) for side in SIDES}
    return Mean(edges, means, step, len(alike))


def _histogram(title: str, mean: Mean, colour: str, behind: Selection) -> Panel:
    edges = mean.edges
    traces = tuple(
        Trace(f"{side} the amplifier", tone, "bins", edges[:-1], mean.shares[side], x_high=edges[1:], runs=(behind,))
        for side, tone in zip(SIDES, (MUTED.light, colour), strict=True)
    )
    middles = [(low + high) / 2 for low, high in pairwise(edges)]
    before, after = (float(np.dot(middles, mean.shares[side])) for side in SIDES)
    alt = (
        f"{title}: share of points by density, before and after the amplifier. Mean about {before:.3g} before and "
        f"{after:.3g} after."
    )
    scale, linear_below = axis_of(edges)
    limits = (edges[0], edges[-1])
    return Panel(title, "density σ", "share of points", traces, alt, scale, "log", limits, linear_below=linear_below)


def axis_of(edges: Sequence[float]) -> tuple[Scale, float]:
    """Return a linear axis for bins of similar width, otherwise a logarithmic axis, through 0 if the bins reach it."""
    widths = [high - low for low, high in pairwise(edges)]
    if max(widths) < 3 * min(widths):
        return "linear", 1.0
    if edges[0] > 0:
        return "log", 1.0
    return "symlog", min(abs(edge) for edge in edges if edge != 0)


def amplifier_over_time(records: Records) -> list[Panel]:
    """Draw α and β against steps, a line per cell; a dashed line marks where they started (1/φ and 1)."""
    colours = colours_of(records.methods)
    panels = []
    for name, letter, start in (("alpha", "α", 1 / GOLDEN), ("beta", "β", 1.0)):
        traces = []
        for cell in records.cells:
            columns = zip(cell.trace.get("step", []), cell.trace.get(name, []), strict=False)
            known = [(float(x), float(y)) for x, y in columns if x is not None and y is not None]
            if len(known) > 1:
                x, y = zip(*known, strict=True)
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


def separation(density: dict[str, list[float]]) -> float | None:
    """Return how often a point inside the true geometry is denser than a point outside (the area under the ROC curve),
    from the histograms of both; 0.5 is chance. Two points in one bin count half. None if the truth is not known.
    """
    inside, outside = (np.asarray(density.get(f"after_{where}", ()), dtype=float) for where in ("inside", "outside"))
    if inside.size == 0 or inside.size != outside.size or inside.sum() == 0 or outside.sum() == 0:
        return None
    below = np.cumsum(outside) - outside
    return float(np.sum(inside * (below + 0.5 * outside)) / (inside.sum() * outside.sum()))


def separation_grid(records: Records) -> Grid:
    columns = [Column("scene", numeric=False), *(Column(method, method) for method in records.methods)]
    rows = []
    for scene in records.scenes:
        row = [Entry(scene)]
        for method in records.methods:
            ends = [cell.curve[-1].density or {} for cell in records.cells_of(scene, method) if cell.status == "done"]
            known = [value for value in map(separation, ends) if value is not None]
            behind = Selection(scene, method)
            row.append(Entry(number(fmean(known), 3), value=fmean(known), runs=behind) if known else EMPTY)
        rows.append(row)
    note = (
        "How often a point inside the true geometry is denser than a point outside, of points on a grid over the box; "
        "1 is perfect, 0.5 chance. No camera sees the inside of solid things, so no training data teach it."
    )
    caption = "Density against the true geometry"
    return Grid(caption, columns, [row for row in rows if any(entry != EMPTY for entry in row[1:])], note=note)


def printed_form(records: Records) -> str:
    """State the result of another reading of a method that a claim mentions; empty if none was trained."""
    readings = {claim.of.get("beside") for file in records.run.claims or [] for claim in file.claims}
    cell = next((cell for cell in records.extra_cells if cell.method in readings), None)
    comparison = records.comparison(cell.scene, cell.method, records.baseline) if cell else None
    if comparison is None or comparison.difference is None:
        return ""
    method, title = comparison.method, records.run.methods[comparison.method]
    known = f"95{NARROW}% interval {interval(comparison.interval)}; " if comparison.interval else ""
    return (
        f"{title}: {method} − {comparison.against} = {signed(comparison.difference)} dB on {comparison.scene} "
        f"({known}{counted(comparison.pairs, 'seed')}). Where a method caps density, as Listing 2 does, how opaque a "
        "surface can be depends on the unit of length, which the paper does not name; Alpha Invariance (arXiv "
        "2404.02155) is about this dependence."
    )


def further_grid(records: Records) -> Grid:
    scene, rows, baseline = next((cell.scene for cell in records.extra_cells), ""), [], records.baseline
    for method, title in records.run.methods.items():
        cells = [cell for cell in records.extra_cells if (cell.scene, cell.method) == (scene, method)]
        if not cells:
            continue
        psnr = [value for cell in cells if (value := cell.scores.get("psnr")) is not None]
        comparison = records.comparison(scene, method, baseline)
        against, verdict = EMPTY, Entry("not compared")
        if comparison is not None:
            verdict = Entry(phrase_with(comparison.verdict, comparison.simultaneous))
            if comparison.difference is not None:
                pair = interval(comparison.simultaneous or comparison.interval)
                against = Entry(signed(comparison.difference), pair, value=comparison.difference)
        rows.append([Entry(method, title), _score(psnr) if psnr else EMPTY, against, verdict])
    columns = [
        Column("method", numeric=False),
        Column("test PSNR", small="dB"),
        Column(f"− {baseline}", small="dB, 95 % interval on this scene"),
        Column("sign, size", numeric=False),
    ]
    return Grid(f"Further methods on {scene}", columns, rows, filtered=False)


def _score(psnr: list[float]) -> Entry:
    more = f"± {number(stdev(psnr))}, {counted(len(psnr), 'seed')}" if len(psnr) > 1 else "1 seed"
    return Entry(number(fmean(psnr)), more, value=fmean(psnr))
