"""Histograms of density before and after the amplifier, and the ladder of units in which density is bounded."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from statistics import fmean, stdev

from harness.records.cells import CellRecord, Checkpoint
from reports.data.load import Records
from reports.data.selection import Selection
from reports.data.wording import NARROW, count, counted, interval, number, signed
from reports.drawing import palette
from reports.drawing.figure import Plot, padded, plots
from reports.drawing.palette import MUTED, colours_of
from reports.drawing.traces import Panel, Scale, Trace
from reports.page.grid import EMPTY, Column, Entry, Grid

GOLDEN = (1 + 5**0.5) / 2
FOOT = 1e-5 / 1.6
"""The foot of the axis of shares: smaller ones are drawn on it, so that empty bins have a place."""


@dataclass(frozen=True)
class Mean:
    """The mean shares over seeds, of one method on one scene at one step."""

    edges: list[float]
    before: list[float]
    after: list[float]
    step: int
    seeds: int
    finished: bool
    """Whether it is of finished runs; otherwise there is none, and it is of others."""

    @property
    def words(self) -> str:
        return f"step {count(self.step)}, {counted(self.seeds, 'seed' if self.finished else 'unfinished seed')}"


def density_histograms(records: Records) -> list[Panel]:
    """Draw a panel for each scene and method with an amplifier: mean over seeds, the last step that all
    of them have.
    """
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
    """Return the methods whose density is changed on its way to the picture."""
    found = {cell.method for cell in records.cells if any(map(_amplifies, cell.curve))}
    return [method for method in records.methods if method in found]


def _amplifies(point: Checkpoint) -> bool:
    density = point.density
    if not density or not _is_histogram(density):
        return False
    return point.alpha is not None or density["before"] != density["after"]


def _mean_density(cells: list[CellRecord]) -> Mean | None:
    """Return the mean over finished runs, or over the others if there is none."""
    finished = [cell for cell in cells if cell.status == "done"]
    return _mean_of(finished, True) or _mean_of([cell for cell in cells if cell not in finished], False)


def _mean_of(cells: list[CellRecord], finished: bool) -> Mean | None:
    """Average at the step, and with the bins, that most runs share, and of these at the last step: a run that ended
    early is not mixed with others that went on.
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
    """Return a linear axis for evenly wide bins, otherwise a logarithmic one, through zero if the bins reach it."""
    widths = [high - low for low, high in pairwise(edges)]
    if max(widths) < 3 * min(widths):
        return "linear", 1.0
    if edges[0] > 0:
        return "log", 1.0
    return "symlog", min(abs(edge) for edge in edges if edge != 0)


def _shift(mean: Mean) -> str:
    """Return the means of both histograms, from the bins' middles."""
    middles = [(low + high) / 2 for low, high in pairwise(mean.edges)]
    means = [
        sum(middle * share for middle, share in zip(middles, shares, strict=True))
        for shares in (mean.before, mean.after)
    ]
    return f"Mean about {means[0]:.3g} before and {means[1]:.3g} after."


def amplifier_over_time(records: Records) -> list[Panel]:
    """Draw α and β against steps: one line per cell, dashed where they started (1/φ and 1)."""
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


PRINTED = "qnerf_printed"
BASES = ("nerf", "qnerf")
MARKERS = {"nerf": "o", "qnerf": "D"}
ALPHA_INVARIANCE = "arXiv 2404.02155"


@dataclass(frozen=True)
class Rung:
    """One method in one unit of density."""

    base: str
    method: str
    scale: float
    """The density per half of the box's longest side where the amplifier gives 1."""
    psnr: list[float]
    """The scores, one per seed."""


@dataclass(frozen=True)
class Units:
    """The section of the page."""

    scene: str
    sentences: list[str]
    ladder: list[Plot]
    table: Grid | None
    beside: Grid | None


def units(records: Records) -> Units | None:
    """Return the section; None if no method was trained on one scene alone."""
    scenes = list(dict.fromkeys(cell.scene for cell in records.extra_cells))
    if not scenes:
        return None
    scene = scenes[0]
    rungs = rungs_of(records, scene)
    sentences = [said for said in (spread(rungs, scene), printed_form(records)) if said]
    drawn = ladder_panel(records)
    return Units(
        scene, sentences, plots([drawn], "units") if drawn else [], ladder_grid(rungs), beside_grid(records, scene)
    )


def ladder_panel(records: Records) -> Panel | None:
    """Draw the picture of the section; None if there are no three units to compare."""
    scene = next((cell.scene for cell in records.extra_cells), None)
    rungs = rungs_of(records, scene) if scene else []
    return panel(rungs, records, scene) if scene and len({rung.scale for rung in rungs}) > 2 else None


def rungs_of(records: Records, scene: str) -> list[Rung]:
    """Return the rungs in the order of their units; NeRF and Q-NeRF themselves are among them."""
    known = records.run.settings.get("density_units")
    found = []
    for method, unit in known.items() if isinstance(known, dict) else ():
        base = next((name for name in BASES if method == name or method.startswith(f"{name}_unit_")), None)
        psnr = scores(records.cells_of(scene, method))
        if base is not None and psnr:
            found.append(Rung(base, method, float(unit["scale"]), psnr))
    return sorted(found, key=lambda rung: (rung.base, rung.scale))


def scores(cells: list[CellRecord]) -> list[float]:
    """Return the test PSNR of the cells that have one."""
    return [value for cell in cells if (value := cell.scores.get("psnr")) is not None]


def spread(rungs: list[Rung], scene: str) -> str:
    """State how far each method moves over the units that all were trained in, in one sentence."""
    said = []
    for base in BASES:
        means = [fmean(rung.psnr) for rung in rungs if rung.base == base]
        if len(means) > 1:
            low, high = min(means), max(means)
            said.append(f"{base} scores {number(low, 1)} to {number(high, 1)} dB")
    scales = [rung.scale for rung in rungs]
    if not said:
        return ""
    between = f"between {min(scales):g} and {max(scales):g} per half of the box"
    return f"With a unit of density {between}, {' and '.join(said)} on {scene}."


def printed_form(records: Records) -> str:
    """State the result of the printed form, and its reason; empty if it was not trained."""
    scene = next((cell.scene for cell in records.extra_cells if cell.method == PRINTED), None)
    one = records.comparison(scene, PRINTED, "nerf") if scene else None
    if one is None or one.difference is None:
        return ""
    said = f"95{NARROW}% interval {interval(one.interval)}; " if one.interval else ""
    return (
        f"With density at most 1 per scene unit, as Listing 2 reads word for word, {PRINTED} − nerf = "
        f"{signed(one.difference)} dB on {scene} ({said}{counted(one.pairs, 'seed')}). Listing 2 caps density, so "
        f"how opaque a surface can be depends on the unit of length, which the paper does not name; Alpha Invariance "
        f"({ALPHA_INVARIANCE}) is about this dependence."
    )


def panel(rungs: list[Rung], records: Records, scene: str) -> Panel:
    """Draw mean test PSNR against the unit of density; a cross marks the printed form."""
    traces = []
    for base in BASES:
        mine = [rung for rung in rungs if rung.base == base]
        x, y = tuple(rung.scale for rung in mine), tuple(fmean(rung.psnr) for rung in mine)
        colour = palette.KNOWN[base].light
        traces.append(Trace(base, colour, "line", x, y))
        traces.append(Trace(f"{base}: points", colour, "mark", x, y, marker=MARKERS[base]))
    described = records.scene(scene)
    printed = scores(records.cells_of(scene, PRINTED))
    if described is not None and printed:
        lower, upper = described.bounds
        half = 0.5 * max(high - low for low, high in zip(lower, upper, strict=True))
        traces.append(Trace(PRINTED, palette.INK.light, "cross", (half,), (fmean(printed),)))
    if described is not None and described.psnr_floor is not None and rungs:
        ends = (min(rung.scale for rung in rungs), max(rung.scale for rung in rungs))
        traces.append(Trace("floor", palette.MUTED.light, "floor", ends, (described.psnr_floor,) * 2))
    every = [value for trace in traces for value in trace.y]
    said = "; ".join(f"{rung.base} {number(fmean(rung.psnr), 1)} dB at {rung.scale:g}" for rung in rungs)
    return Panel(
        f"Test PSNR on {scene} against the unit of density",
        "density where the amplifier gives 1, per half of the box",
        "test PSNR, dB",
        tuple(traces),
        f"Test PSNR on {scene} against the unit of density: {said}.",
        "log",
        "linear",
        padded([rung.scale for rung in rungs], True),
        padded(every, False),
        size=(5.8, 3.6),
    )


def ladder_grid(rungs: list[Rung]) -> Grid | None:
    """Tabulate one row per unit."""
    if len({rung.scale for rung in rungs}) < 2:
        return None
    columns = [Column("unit of density", small="per half of the box"), *(Column(base, small="dB") for base in BASES)]
    rows = []
    for scale in sorted({rung.scale for rung in rungs}):
        row = [Entry(f"{scale:g}", value=scale)]
        for base in BASES:
            one = next((rung for rung in rungs if (rung.base, rung.scale) == (base, scale)), None)
            row.append(EMPTY if one is None else _score(one.psnr))
        rows.append(row)
    return Grid("The ladder of units", columns, rows, filtered=False)


def _score(psnr: list[float]) -> Entry:
    more = f"± {number(stdev(psnr))}, {counted(len(psnr), 'seed')}" if len(psnr) > 1 else "1 seed"
    return Entry(number(fmean(psnr)), more, value=fmean(psnr))


def beside_grid(records: Records, scene: str) -> Grid | None:
    """Tabulate the further methods that are no rungs of the ladder, each against NeRF."""
    rows = []
    for method in records.run.methods:
        cells = [cell for cell in records.extra_cells if (cell.scene, cell.method) == (scene, method)]
        if not cells or "_unit_" in method:
            continue
        psnr, one = scores(cells), records.comparison(scene, method, "nerf")
        against = EMPTY
        if one is not None and one.difference is not None:
            against = Entry(signed(one.difference), interval(one.simultaneous or one.interval), value=one.difference)
        said = Entry(one.verdict if one is not None else "not compared")
        rows.append([Entry(method, records.run.methods[method]), _score(psnr) if psnr else EMPTY, against, said])
    columns = [
        Column("method", numeric=False),
        Column("test PSNR", small="dB"),
        Column("− nerf", small="dB, 95 % interval on this scene"),
        Column("verdict", numeric=False),
    ]
    return Grid(f"Further methods on {scene}", columns, rows, filtered=False) if rows else None
