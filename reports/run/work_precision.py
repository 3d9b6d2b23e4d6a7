"""Work–precision diagrams of training: an error against its cost, log–log, for every measure and axis that the
records have.

Lines and levels are geometric, as the axes are logarithmic. A band spreads both ways: at a checkpoint it reaches one
standard deviation over the seeds (of the logarithms) up and down in error, and left and right in cost.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean, stdev
from typing import Any, TypeVar

from markupsafe import Markup

from harness.records.cells import CellRecord, Checkpoint
from harness.records.metric_table import METRICS, Metric
from reports.data.load import Records
from reports.data.selection import Selection
from reports.data.table import cells_frame
from reports.data.wording import counted, listed, of_any_size
from reports.drawing.figure import padded, svg, with_common_limits
from reports.drawing.palette import INK, colours_of
from reports.drawing.traces import Panel, Trace

FURTHEST = 10
"""The factor below the smallest error beyond which a floor would only squeeze the curves: it is stated instead."""
SMALL, LARGE = (3.7, 2.6), (6.1, 4.4)
"""The inches of a scene's panel, and of that of all scenes together."""
FORWARD_AND_BACKWARD = 3
"""The cost of a training step in forward passes, as `harness.training.cell_training` counts it."""
EVERYWHERE = "all scenes"
Key = TypeVar("Key", bound=Any)


@dataclass(frozen=True)
class Cost:
    """The cost of a checkpoint so far."""

    name: str
    label: str
    of: Callable[[CellRecord, Checkpoint], float | None]


MEASURES = tuple(sorted((metric for metric in METRICS.values() if metric.error), key=lambda one: one.higher_is_better))
COSTS = (
    Cost("seconds", "training seconds", lambda cell, point: point.seconds),
    Cost("rays", "rays", lambda cell, point: _times(point.step, cell.properties.get("rays_per_step"))),
    Cost("evaluations", "network evaluations", lambda cell, point: float(point.network_evaluations)),
    Cost("flops", "training FLOPs", lambda cell, point: _training_flops(cell, point)),
)


@dataclass(frozen=True)
class Diagram:
    """One measure against one cost: a panel for all scenes together, if there are several, and one per scene."""

    measure: Metric
    cost: Cost
    panels: list[Panel]
    notes: list[list[str]]
    """The notes beside each panel: what diverged, what could not be drawn."""


def diagrams(records: Records) -> list[Diagram]:
    """Return every pair of a measure and a cost for which the records suffice for a line."""
    floors = noise_floors(records)
    made = [_diagram(records, measure, cost, floors) for measure in MEASURES for cost in COSTS]
    return [one for one in made if one.panels]


@dataclass(frozen=True)
class Point:
    """A checkpoint of one run, or of one seed over all scenes."""

    scene: str
    method: str
    seed: int
    status: str
    step: int
    cost: float
    error: float


def error_of(point: Checkpoint, measure: Metric) -> float | None:
    """Return a checkpoint's error by a metric: less is better, and 0 is perfect."""
    score = getattr(point, measure.name)
    return 1.0 - score if measure.higher_is_better and score is not None else score


def points_of(records: Records, measure: Metric, cost: Cost) -> list[Point]:
    """Return every checkpoint whose cost and error are above 0, run by run in the order of training."""
    return [
        Point(cell.scene, cell.method, cell.seed, cell.status, point.step, spent, error)
        for cell in records.cells
        for point in sorted(cell.curve, key=lambda point: point.step)
        if (spent := cost.of(cell, point)) is not None and (error := error_of(point, measure)) is not None
        if spent > 0 and error > 0
    ]


def _diagram(records: Records, measure: Metric, cost: Cost, floors: dict[str, float]) -> Diagram:
    every = points_of(records, measure, cost)
    known = floors if measure.name == "rmse_linear" else {}
    chosen = [(scene, [one for one in every if one.scene == scene], known.get(scene)) for scene in records.scenes]
    if len(records.scenes) > 1:
        shared = geometric_mean(known.values()) if set(known) == set(records.scenes) else None
        chosen.insert(0, (EVERYWHERE, over_scenes(every, records), shared))
    drawn = [
        (_panel(records, title, points, measure, cost, floor), _notes(records, title, points, floor))
        for title, points, floor in chosen
        if points
    ]
    panels = with_common_limits([panel for panel, _ in drawn], "x")
    return Diagram(measure, cost, panels, [notes for _, notes in drawn])


def over_scenes(every: list[Point], records: Records) -> list[Point]:
    """Return geometric means over the scenes, per method, seed and step, where every scene has a point.

    A seed is done if it is in every scene; else it ends where its first scene ended, with that scene's status.
    """
    lost = {(cell.method, cell.seed): cell.status for cell in records.cells if cell.status != "done"}
    found = []
    for (method, seed, step), group in grouped(every, lambda one: (one.method, one.seed, one.step)).items():
        if len({one.scene for one in group}) == len(records.scenes):
            cost, error = (geometric_mean(getattr(one, name) for one in group) for name in ("cost", "error"))
            found.append(Point(EVERYWHERE, method, seed, lost.get((method, seed), "done"), step, cost, error))
    return found


def grouped(every: list[Point], key: Callable[[Point], Key]) -> dict[Key, list[Point]]:
    """Group after sorting by `key`."""
    found: dict[Key, list[Point]] = {}
    for one in every:
        found.setdefault(key(one), []).append(one)
    return dict(sorted(found.items()))


def geometric_mean(values: Iterable[float]) -> float:
    return math.exp(fmean(map(math.log, values)))


def _panel(
    records: Records, title: str, points: list[Point], measure: Metric, cost: Cost, floor: float | None
) -> Panel:
    traces = traces_of(points, {name: colour.light for name, colour in colours_of(records.methods).items()})
    ends = [f"{one.label.removesuffix(' mean')} {one.y[-1]:.4g}" for one in traces if one.kind == "line"]
    ends += [one.label for one in traces if one.kind == "cross"]
    if _is_near(floor, points):
        level = float(floor or 0.0)
        span = (min(one.cost for one in points), max(one.cost for one in points))
        traces.append(Trace("noise of the ground truth", INK.light, "floor", span, (level, level)))
        ends.append(f"noise of the ground truth {level:.4g}")
    alt = f"{title}: {measure.error} against {cost.label}. At the end: {', '.join(ends) or 'no finished run'}."
    limits = padded([y for trace in traces for y in trace.y if not math.isnan(y)], log=True)
    size = LARGE if title == EVERYWHERE else SMALL
    return Panel(title, cost.label, measure.error, tuple(traces), alt, "log", "log", y_limits=limits, size=size)


def _is_near(floor: float | None, points: list[Point]) -> bool:
    return floor is not None and floor >= min(one.error for one in points) / FURTHEST


def _notes(records: Records, title: str, points: list[Point], floor: float | None) -> list[str]:
    cells = [cell for cell in records.cells if title in (EVERYWHERE, cell.scene)]
    said = []
    for method in records.methods:
        own = [cell for cell in cells if cell.method == method]
        lost = [cell for cell in own if cell.status in ("diverged", "error")]
        if lost:
            others = "; the mean is of the others" if len(lost) < len(own) else ""
            said.append(f"✕ {method}: {len(lost)} of {counted(len(own), 'run')} did not finish{others}")
    drawn = {one.method for one in points}
    absent = [method for method in records.methods if method not in drawn]
    said += [f"not known of {listed(absent)}"] if absent else []
    if floor is not None and not _is_near(floor, points):
        said.append(f"noise of the ground truth: {of_any_size(floor, 2)}, far below")
    return said


def traces_of(points: list[Point], colours: dict[str, str]) -> list[Trace]:
    """Return bands, then every seed as a thin line, then the means of the finished seeds, then a cross where a run
    ended.
    """
    bands, thin, thick, crosses = [], [], [], []
    scene = next((one.scene for one in points if one.scene != EVERYWHERE), "")
    for method, colour in colours.items():
        finished = []
        for seed, run in grouped([one for one in points if one.method == method], lambda one: one.seed).items():
            x, y = tuple(one.cost for one in run), tuple(one.error for one in run)
            steps, behind = tuple(one.step for one in run), (Selection(scene, method, seed=seed),)
            thin.append(Trace(f"{method} seed {seed}", colour, "thin", x, y, runs=behind, steps=steps))
            if run[0].status == "done":
                finished.append(run)
            else:
                words = f"{method} seed {seed} {ENDS[run[0].status]}"
                crosses.append(Trace(words, colour, "cross", x[-1:], y[-1:], runs=behind, steps=steps[-1:]))
        middle = middle_of(finished)
        if middle:
            x, y = tuple(one.cost for one in middle), tuple(one.error for one in middle)
            steps, behind = tuple(one.step for one in middle), (Selection(scene, method),)
            thick.append(Trace(f"{method} mean", colour, "line", x, y, runs=behind, steps=steps))
        if len(finished) > 1 and middle:
            bands.append(Trace(f"{method} spread", colour, "area", *outline(middle)))
    return [*bands, *thin, *thick, *crosses]


ENDS = {"diverged": "diverged", "error": "failed", "not_available": "not available"}


@dataclass(frozen=True)
class Middle:
    """The geometric mean over seeds at one checkpoint, and the standard deviation of the logarithm as a factor."""

    cost: float
    error: float
    cost_factor: float
    error_factor: float
    step: int = 0

    @property
    def corners(self) -> list[tuple[float, float]]:
        """Return the corners in logarithms."""
        x, y, dx, dy = map(math.log, (self.cost, self.error, self.cost_factor, self.error_factor))
        return [(x - dx, y - dy), (x + dx, y - dy), (x + dx, y + dy), (x - dx, y + dy)]


def middle_of(finished: list[list[Point]]) -> list[Middle]:
    """Return the means at the steps that all of `finished` share, in their order."""
    found = []
    for step, group in grouped([one for run in finished for one in run], lambda one: one.step).items():
        if len(group) == len(finished):
            columns = [[math.log(getattr(one, name)) for one in group] for name in ("cost", "error")]
            means = [fmean(logs) for logs in columns]
            spreads = [stdev(logs) if len(logs) > 1 else 0.0 for logs in columns]
            (cost, error), (wide, high) = ([math.exp(log) for log in logs] for logs in (means, spreads))
            found.append(Middle(cost, error, wide, high, step))
    return found


def outline(middle: list[Middle]) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the band as polygons with NaN between them, all turning the same way, so that together they fill their
    union: the hull of the rectangles of every two consecutive checkpoints.
    """
    pairs = list(pairwise(middle)) or [(middle[0], middle[0])]
    x: list[float] = []
    y: list[float] = []
    for first, second in pairs:
        corners = hull([*first.corners, *second.corners])
        x += [*(math.exp(at) for at, _ in corners), math.nan]
        y += [*(math.exp(at) for _, at in corners), math.nan]
    return tuple(x[:-1]), tuple(y[:-1])


def hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners of the convex hull, anticlockwise (Andrew 1979)."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return ordered

    def half(chain: list[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for point in chain:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], point) <= 0:
                kept.pop()
            kept.append(point)
        return kept[:-1]

    return half(ordered) + half(ordered[::-1])


def _turn(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Return a number above 0 if the way from `a` over `b` to `c` turns left."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def noise_floors(records: Records) -> dict[str, float]:
    """Map scene → linear RMSE that the ground truth's own noise causes.

    The ceiling is known in display colour. It is carried over to linear light by the ratio of the two errors
    that the finished cells of the scene show: an estimate, exact only if noise and error lie in the same tones.
    """
    frame = cells_frame(records)
    done = frame[frame["status"] == "done"].dropna(subset=["psnr", "rmse_linear", "psnr_ceiling"])
    ratio = done["rmse_linear"] / 10 ** (-done["psnr"] / 20)
    floors = (ratio * 10 ** (-done["psnr_ceiling"] / 20)).groupby(done["scene"]).median()
    return {str(scene): float(value) for scene, value in floors.items() if value > 0}


def _times(step: int, rays: float | str | None) -> float | None:
    return step * float(rays) if isinstance(rays, (int, float)) else None


def _training_flops(cell: CellRecord, point: Checkpoint) -> float | None:
    one = cell.properties.get("flops_per_evaluation")
    return FORWARD_AND_BACKWARD * point.network_evaluations * float(one) if isinstance(one, (int, float)) else None


@dataclass(frozen=True)
class Plot:
    title: str
    svg: Markup
    notes: list[str]


@dataclass(frozen=True)
class Choice:
    """The display for a chosen measure and cost."""

    measure: Metric
    cost: Cost
    plots: list[Plot]

    @property
    def name(self) -> str:
        return f"{self.measure.name}-{self.cost.name}"


@dataclass(frozen=True)
class Work:
    measures: list[Metric]
    costs: list[Cost]
    choices: list[Choice]
    """The choices for which the records suffice."""

    @property
    def rules(self) -> Markup:
        """Return the style that shows the choice, and the reason if nothing can be shown for it."""
        known = {one.name for one in self.choices}
        pairs = [f"{measure.name}-{cost.name}" for measure in self.measures for cost in self.costs]
        shown = [_chosen(name) + f" .{name if name in known else 'unknown'}" for name in pairs]
        return Markup(f"{','.join(shown)}{{display:block}}\n")


def work(records: Records) -> Work | None:
    """Return the section; None if no cell has a curve."""
    made = diagrams(records)
    choices = [
        Choice(
            one.measure,
            one.cost,
            [
                Plot(panel.title, svg(panel, f"{one.measure.name}-{one.cost.name}-{place}"), notes)
                for place, (panel, notes) in enumerate(zip(one.panels, one.notes, strict=True))
            ],
        )
        for one in made
    ]
    if not choices:
        return None
    return Work(
        list(dict.fromkeys(one.measure for one in choices)), list(dict.fromkeys(one.cost for one in choices)), choices
    )


def _chosen(name: str) -> str:
    measure, _, cost = name.partition("-")
    return f'.chooser:has([name=measure][value="{measure}"]:checked):has([name=cost][value="{cost}"]:checked)'
