"""The unit of density: what explains the answer, on the one scene on which further methods were trained.

The paper names no unit of length. Every method has the same unit of density here, half of the longest side of the
scene's box; a ladder shows what another unit would have done to NeRF and to Q-NeRF, and where the printed form stands
on it.
"""

from dataclasses import dataclass
from statistics import fmean, stdev

from harness.records import CellRecord
from reports import palette
from reports.figure import padded
from reports.grid import EMPTY, Column, Entry, Grid
from reports.load import Records
from reports.plots import Plot, plots
from reports.trace_data import Panel, Trace
from reports.wording import NARROW, counted, interval, number, signed

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
    """Density per half of the box's longest side where the amplifier gives 1."""
    psnr: list[float]
    """A score a seed."""


@dataclass(frozen=True)
class Units:
    """The section of the page."""

    scene: str
    sentences: list[str]
    ladder: list[Plot]
    table: Grid | None
    beside: Grid | None


def units(records: Records) -> Units | None:
    """None where no method was trained on one scene alone."""
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
    """The picture of the section; None where there are no three units to compare."""
    scene = next((cell.scene for cell in records.extra_cells), None)
    rungs = rungs_of(records, scene) if scene else []
    return panel(rungs, records, scene) if scene and len({rung.scale for rung in rungs}) > 2 else None


def rungs_of(records: Records, scene: str) -> list[Rung]:
    """In the order of their units; NeRF and Q-NeRF themselves are among them."""
    known = records.run.settings.get("density_units")
    found = []
    for method, unit in known.items() if isinstance(known, dict) else ():
        base = next((name for name in BASES if method == name or method.startswith(f"{name}_unit_")), None)
        psnr = scores(records.cells_of(scene, method))
        if base is not None and psnr:
            found.append(Rung(base, method, float(unit["scale"]), psnr))
    return sorted(found, key=lambda rung: (rung.base, rung.scale))


def scores(cells: list[CellRecord]) -> list[float]:
    """Test PSNR of the cells that have one."""
    return [value for cell in cells if (value := cell.scores.get("psnr")) is not None]


def spread(rungs: list[Rung], scene: str) -> str:
    """How far each method moves over the units that all were trained in, in one sentence."""
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
    """What the printed form does, and the one sentence why; empty where it was not trained."""
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
    """Mean test PSNR against the unit of density; a cross marks where the printed form stands."""
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
    """A row for each unit."""
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
    """The further methods that are no rungs of the ladder, each against NeRF."""
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
