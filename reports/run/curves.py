"""Learning curves: test PSNR against steps and time, and work–precision diagrams of every error against every cost.

Both go from records to a frame of checkpoints, then to traces, then to panels. Seeds are thin lines, the mean of the
finished seeds is thick, and a cross marks where a run ended early. If both axes are logarithmic, means are geometric,
and a band shows one standard deviation over the seeds (of the logarithms), vertically in error, horizontally in cost.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
import pandas as pd

from harness.records.metric_table import METRICS
from reports.data.load import Records
from reports.data.selection import Selection
from reports.data.table import cells_frame, curves_frame
from reports.data.wording import counted, listed, of_any_size
from reports.drawing.figure import padded, with_common_limits
from reports.drawing.palette import INK, MUTED, Colour, colours_of
from reports.drawing.traces import Kind, Panel, Trace

EVERYWHERE = "all scenes"
NEAR_DB = 2.0
"""The maximum distance in dB from the curves at which a floor or ceiling is drawn; the table has all of them."""
FURTHEST = 10
"""The maximum factor between the smallest error and a drawn floor: a lower floor would squeeze the curves."""
SMALL, LARGE = (3.7, 2.6), (6.1, 4.4)
"""The size in inches of the panel of a scene, and of all scenes together."""
ENDS = {"diverged": "diverged", "error": "failed", "not_available": "not available"}


class Choice(NamedTuple):
    name: str
    label: str


class Level(NamedTuple):
    label: str
    height: float | None
    colour: Colour = MUTED


COSTS = (
    Choice("seconds", "training seconds"),
    Choice("core_seconds", "core seconds"),
    Choice("rays", "rays"),
    Choice("evaluations", "network evaluations"),
    Choice("flops", "training FLOPs"),
)
ERRORS = tuple(
    Choice(metric.name, metric.error)
    for metric in sorted(METRICS.values(), key=lambda metric: metric.higher_is_better)
    if metric.error
)
AXES = {"step": "training step", "seconds": "training seconds", "core_seconds": "core seconds"}


def convergence(records: Records, axis: str) -> list[Panel]:
    """Draw test PSNR against one of `AXES`: a panel for each scene, the mean over several scenes first."""
    colours, panels = colours_of(records.methods), []
    guests: dict[str, pd.DataFrame] = {}
    if axis != "step":
        guests = dict(_along(replace(records, cells=records.guest_cells), axis, by_checkpoint=True))
    for scene, points in _along(records, axis):
        about = records.scene(scene)
        levels = [Level("floor", about.psnr_floor), Level("ceiling", about.psnr_ceiling, INK)] if about else []
        near = [
            level
            for level in levels
            if level.height is not None and points["y"].min() - NEAR_DB <= level.height <= points["y"].max() + NEAR_DB
        ]
        title = "all scenes (mean)" if scene == EVERYWHERE else scene
        traces = traces_of(points, colours, scene, "psnr", log=False)
        if scene in guests:
            of_guests = colours_of(records.pictured)
            own = {name: of_guests[name] for name in records.run.guests}
            # the page has no data of the runs of guests
            traces += [replace(trace, runs=()) for trace in traces_of(guests[scene], own, scene, "psnr", log=False)]
        panels.append(_panel(title, AXES[axis], "test PSNR (dB)", traces, points, near))
    return with_common_limits(panels, "x")


def _along(records: Records, axis: str, by_checkpoint: bool = False) -> Iterable[tuple[str, pd.DataFrame]]:
    """Yield the test PSNR of each scene's cells over an axis, the mean over several scenes first.

    Scenes are averaged at equal steps, or `by_checkpoint`, as budgets of seconds end at different steps.
    """
    curves = curves_frame(records)
    if by_checkpoint:
        curves["step"] = curves.groupby(["scene", "method", "seed"]).cumcount()
    return by_scene(points_of(curves.assign(x=curves[axis], y=curves["psnr"])), records, log=False)


@dataclass(frozen=True)
class Diagram:
    """An error against a cost: a panel for all scenes together, if there are several, and a panel per scene."""

    measure: Choice
    cost: Choice
    panels: list[Panel]
    notes: list[list[str]]

    @property
    def name(self) -> str:
        return f"{self.measure.name}-{self.cost.name}"


def diagrams(records: Records) -> list[Diagram]:
    """Return a diagram for every pair of an error and a cost that the records have."""
    curves, floors = curves_frame(records), noise_floors(records)
    # the page of a run that still trains is made again and again
    measures = ERRORS if records.run.finished else ERRORS[:1]
    made = [_diagram(records, curves, measure, cost, floors) for measure in measures for cost in COSTS]
    return [diagram for diagram in made if diagram.panels]


def _diagram(
    records: Records, curves: pd.DataFrame, measure: Choice, cost: Choice, floors: dict[str, float]
) -> Diagram:
    score = curves[measure.name]
    error = 1.0 - score if METRICS[measure.name].higher_is_better else score
    chosen = points_of(curves.assign(x=curves[cost.name], y=error))
    known = floors if measure.name == "rmse_linear" else {}
    if set(known) == set(records.scenes):
        known = {**known, EVERYWHERE: math.exp(np.log(list(known.values())).mean())}
    panels, notes = [], []
    for scene, points in by_scene(chosen[chosen["y"] > 0], records, log=True):
        floor = known.get(scene)
        is_near = floor is not None and floor >= points["y"].min() / FURTHEST
        traces = traces_of(points, colours_of(records.methods), scene, measure.name, log=True)
        levels = [Level("noise of the ground truth", floor, INK)] if is_near else []
        panel = _panel(scene, cost.label, measure.label, traces, points, levels)
        heights = [y for trace in panel.traces for y in trace.y if not math.isnan(y)]
        size = LARGE if scene == EVERYWHERE else SMALL
        panels.append(replace(panel, y_scale="log", y_limits=padded(heights, log=True), size=size))
        far = f"noise of the ground truth: {of_any_size(floor, 2)}, far below"
        notes.append([*_notes(records, scene, points), *([far] if floor is not None and not is_near else [])])
    return Diagram(measure, cost, with_common_limits(panels, "x"), notes)


def _notes(records: Records, scene: str, points: pd.DataFrame) -> list[str]:
    notes = []
    for method in records.methods:
        own = [cell for cell in records.cells if cell.method == method and scene in (EVERYWHERE, cell.scene)]
        lost = sum(cell.status in ("diverged", "error") for cell in own)
        others = "; the mean is of the others" if lost < len(own) else ""
        notes += [f"✕ {method}: {lost} of {counted(len(own), 'run')} did not finish{others}"] if lost else []
    absent = [method for method in records.methods if method not in set(points["method"])]
    return [*notes, f"not known for {listed(absent)}"] if absent else notes


def points_of(curves: pd.DataFrame) -> pd.DataFrame:
    """Return the checkpoints that have `x` and `y`, and an `x` above 0, for a logarithmic axis."""
    points = curves.dropna(subset=["x", "y"])
    return points[points["x"] > 0]


def by_scene(points: pd.DataFrame, records: Records, log: bool) -> Iterable[tuple[str, pd.DataFrame]]:
    """Yield the points of all scenes together, if there are several, and of each scene that has points."""
    together = [(EVERYWHERE, over_scenes(points, records, log))] if len(records.scenes) > 1 else []
    chosen = [*together, *((scene, points[points["scene"] == scene]) for scene in records.scenes)]
    return ((scene, some) for scene, some in chosen if len(some))


def over_scenes(points: pd.DataFrame, records: Records, log: bool) -> pd.DataFrame:
    """Return means over the scenes, per method, seed and step, where every scene has a point.

    A seed is done if it is done in every scene; else it ends with its first scene that ended early, and its status.
    """
    lost = {(cell.method, cell.seed): cell.status for cell in records.cells if cell.status != "done"}
    values = np.log(points[["x", "y"]]) if log else points[["x", "y"]]
    grouped = values.groupby([points[name] for name in ("method", "seed", "step")])
    means = grouped.mean()[grouped.size() == len(records.scenes)]
    means = (np.exp(means) if log else means).reset_index()
    keys = zip(means["method"], means["seed"], strict=True)
    return means.assign(status=[lost.get(key, "done") for key in keys])


def traces_of(points: pd.DataFrame, colours: dict[str, Colour], scene: str, metric: str, log: bool) -> list[Trace]:
    """Return the bands (only if `log`), the seeds, the means, and a cross where a run ended early."""
    where = "" if scene == EVERYWHERE else scene
    bands, thin, thick, crosses = [], [], [], []
    for method, colour in colours.items():
        own = points[points["method"] == method]
        for seed, run in own.groupby("seed"):
            behind, status = Selection(where, method, metric=metric, seed=int(seed)), run["status"].iloc[0]
            thin.append(_trace(f"{method} seed {seed}", colour, "thin", run, behind))
            if status != "done":
                crosses.append(_trace(f"{method} seed {seed} {ENDS[status]}", colour, "cross", run.tail(1), behind))
        finished = own[own["status"] == "done"]
        middle = middle_of(finished, log)
        if len(middle):
            thick.append(_trace(f"{method} mean", colour, "line", middle, Selection(where, method, metric=metric)))
        if len(middle) and log and finished["seed"].nunique() > 1:
            bands.append(Trace(f"{method} spread", colour.light, "area", *outline(middle)))
    return [*bands, *thin, *thick, *crosses]


def _trace(label: str, colour: Colour, kind: Kind, points: pd.DataFrame, behind: Selection) -> Trace:
    x, y = (tuple(map(float, points[name])) for name in "xy")
    return Trace(label, colour.light, kind, x, y, runs=(behind,), steps=tuple(map(int, points["step"])))


def middle_of(runs: pd.DataFrame, log: bool) -> pd.DataFrame:
    """Return the means over seeds at the steps that all `runs` share; geometric means if `log`.

    `dx` and `dy` are the sample standard deviations over the seeds, of the logarithms if `log`; 0 for a single seed.
    """
    values = np.log(runs[["x", "y"]]) if log else runs[["x", "y"]]
    grouped = values.groupby(runs["step"])
    shared = grouped.size() == runs["seed"].nunique()
    means, spreads = grouped.mean()[shared], grouped.std()[shared].fillna(0.0)
    means = np.exp(means) if log else means
    return means.assign(dx=spreads["x"], dy=spreads["y"]).reset_index()


def _panel(
    title: str, x_label: str, y_label: str, traces: list[Trace], points: pd.DataFrame, levels: list[Level]
) -> Panel:
    ends = [f"{trace.label.removesuffix(' mean')} {trace.y[-1]:.4g}" for trace in traces if trace.kind == "line"]
    ends += [trace.label for trace in traces if trace.kind == "cross"]
    span = (float(points["x"].min()), float(points["x"].max()))
    for label, height, colour in levels:
        traces.append(Trace(label, colour.light, "floor", span, (float(height or 0.0),) * 2))
        ends += [f"{label} {height:.4g}"] if label.startswith("noise") else []
    alt = f"{title}: {y_label} against {x_label}. At the end: {', '.join(ends) or 'no finished run'}."
    return Panel(title, x_label, y_label, tuple(traces), alt, "log")


def outline(middle: pd.DataFrame) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the band as polygons with NaN between them: the hull of the rectangles of every two consecutive
    checkpoints. All turn the same way, so that together they fill their union.
    """
    x, y = np.log(middle["x"]), np.log(middle["y"])
    rectangles = [
        [(x - dx, y - dy), (x + dx, y - dy), (x + dx, y + dy), (x - dx, y + dy)]
        for x, y, dx, dy in zip(x, y, middle["dx"], middle["dy"], strict=True)
    ]
    corners: list[tuple[float, float]] = []
    for first, second in list(pairwise(rectangles)) or [(rectangles[0], rectangles[0])]:
        corners += [*hull([*first, *second]), (math.nan, math.nan)]
    columns = np.exp(corners[:-1]).T
    return tuple(map(float, columns[0])), tuple(map(float, columns[1]))


def hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners of the convex hull, anticlockwise (Andrew 1979)."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return ordered

    def turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
        """Return a number above 0 if the path from `a` over `b` to `c` turns left."""
        return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])

    def half(chain: list[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for point in chain:
            while len(kept) > 1 and turn(kept[-2], kept[-1], point) <= 0:
                kept.pop()
            kept.append(point)
        return kept[:-1]

    return half(ordered) + half(ordered[::-1])


def noise_floors(records: Records) -> dict[str, float]:
    """Map scene → the linear RMSE that the noise of the ground truth causes.

    The ceiling is known in display colour. The ratio of both errors in the finished cells of the scene converts it to
    linear light: an estimate, exact only if noise and error lie in the same tones.
    """
    frame = cells_frame(records)
    done = frame[frame["status"] == "done"].dropna(subset=["psnr", "rmse_linear", "psnr_ceiling"])
    ratio = done["rmse_linear"] / 10 ** (-done["psnr"] / 20)
    floors = (ratio * 10 ** (-done["psnr_ceiling"] / 20)).groupby(done["scene"]).median()
    return {str(scene): float(value) for scene, value in floors.items() if value > 0}


def chooser_rules(made: list[Diagram]) -> str:
    """Return the style rules that show the chosen diagram, or the note that there is no diagram of this pair."""
    known = {diagram.name for diagram in made}
    pairs = product(
        dict.fromkeys(diagram.measure.name for diagram in made), dict.fromkeys(diagram.cost.name for diagram in made)
    )
    rules = [
        f'.chooser:has([name=measure][value="{measure}"]:checked):has([name=cost][value="{cost}"]:checked) .'
        + (name if (name := f"{measure}-{cost}") in known else "unknown")
        for measure, cost in pairs
    ]
    return f"{','.join(rules)}{{display:block}}\n" if rules else ""
