"""PSNR and root mean square error of every family at every budget, over all scenes and by scene."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from harness.records.study import Series, Table
from harness.studies.evidence.contrasts import without_a_score
from harness.studies.framework import Found, Rows
from harness.studies.frontier.frontier_context import Amount, Frontier, FrontierContext
from harness.studies.frontier.peers import points_of
from harness.verdicts.statistics import paired_difference

AXES: dict[str, tuple[str, Callable[[Any], float]]] = {
    "core_seconds": ("core seconds of training", lambda cell: cell.train_core_seconds),
    "seconds": ("wall seconds of training", lambda cell: cell.train_seconds),
    "evaluations": ("evaluations", lambda cell: cell.curve[-1].network_evaluations),
}
"""The axes, and the cost of a cell; evaluations are those of a network or features, and of Gaussians on rays."""
ERROR = "root mean square error of display colour"
EVERY = "all scenes"
USUAL = Amount().resolution


def error_of(psnr: float) -> float:
    """Convert PSNR to the root mean square error of display colours 0 … 1."""
    return float(10.0 ** (-psnr / 20.0))


def error_against_time(context: FrontierContext) -> Iterator[Found]:
    frontier = context.frontier()
    families = frontier.trained
    yield from overview(frontier)
    yield Table(
        "by_scene", 0, "PSNR by scene and budget, dB, mean over seeds",
        ["scene", "core s", *families],
        [
            [scene, f"{budget:g}", *(_decibels(row[place]) for row in frontier.table(budget, families))]
            for place, scene in enumerate(frontier.amount.scenes)
            for budget in frontier.budgets
        ],
    )  # fmt: skip
    for axis in AXES:
        for scene in (None, *frontier.amount.scenes) if axis == "core_seconds" else (None,):
            yield from lines(frontier, axis, scene)


def larger(context: FrontierContext) -> Iterator[Found]:
    frontier = context.frontier(large=True)
    yield from overview(frontier)
    yield from lines(frontier, "core_seconds", None)


def overview(frontier: Frontier) -> Iterator[Found]:
    """Yield the best mean, what lacks a score, and the errors of colour and depth over the scenes."""
    yield best_mean(frontier)
    for budget in frontier.budgets:
        yield from without_a_score(frontier.cells[budget], f"At {budget:g} core seconds ")
    yield over_scenes(frontier)
    yield depth_over_scenes(frontier)


def best_mean(frontier: Frontier) -> str:
    """Name the best family at the longest budget, with its errors of colour and depth and those of nerf."""
    last, scenes = frontier.budgets[-1], len(frontier.amount.scenes)
    means = {family: frontier.table(last, (family,)).mean() for family in frontier.trained}
    best = max(means, key=lambda family: -np.inf if np.isnan(means[family]) else means[family])
    both = dict.fromkeys((best, "nerf") if "nerf" in means else (best,))
    depths = {family: frontier.mean(last, family, "depth_rmse") for family in both}
    errors = {family: f" (depth error {depth})" if depth else "" for family, depth in depths.items()}
    scores = "; ".join(f"{family} {means[family]:.2f} dB{errors[family]}" for family in both)
    over = f"{scenes} scene{'s' * (scenes > 1)} of {frontier.amount.resolution} pixels"
    which = "the best" if len(means) > 1 else "this"
    return f"At {last:g} core seconds {best} has {which} mean over {over}: {scores}."


def depth_over_scenes(frontier: Frontier) -> Table:
    """Return the error of depth of each family at each budget: its mean over scenes and seeds."""
    rows: Rows = [
        [family, *(frontier.mean(budget, family, "depth_rmse") for budget in frontier.budgets)]
        for family in frontier.trained
    ]
    columns = ["family", *(f"{budget:g} core s" for budget in frontier.budgets)]
    return Table("depth_over_scenes", 0, "RMSE of depth on opaque pixels, mean over scenes, scene units", columns, rows)


def over_scenes(frontier: Frontier) -> Table:
    """Return the mean PSNR of each family at each budget with its 95 % interval over scenes, and the median steps."""
    rows: Rows = []
    for family in frontier.trained:
        entries = []
        for budget in frontier.budgets:
            scores = frontier.table(budget, (family,))[0]
            if np.isnan(scores).any():
                entries.append("a scene without a score")
                continue
            over_all = paired_difference(scores)
            half = "" if over_all.interval is None else f" ± {over_all.interval[1] - over_all.mean:.2f}"
            steps = np.median([cell.steps for cell in frontier.of(budget, family)])
            entries.append(f"{over_all.mean:.2f}{half} ({steps:.0f} steps)")
        rows.append([family, *entries])
    title = "PSNR over scenes, dB: mean ± 95 % interval over scenes (median steps)"
    return Table("over_scenes", 0, title, ["family", *(f"{budget:g} core s" for budget in frontier.budgets)], rows)


def lines(frontier: Frontier, axis: str, scene: str | None) -> Iterator[Series]:
    names, (label, cost) = frontier.amount.scenes, AXES[axis]
    chosen = [names.index(scene)] if scene else list(range(len(names)))
    panel = f"Error against {label}, {scene or EVERY}"
    if frontier.amount.resolution != USUAL:
        panel += f", {frontier.amount.resolution} px"
    for family in frontier.trained:
        x, y, low, high = [], [], [], []
        for budget in frontier.budgets:
            scores = frontier.table(budget, (family,))[0][chosen]
            if np.isnan(scores).any():
                continue
            over_chosen = paired_difference(scores)
            x.append(float(np.median([cost(cell) for cell in frontier.of(budget, family)])))
            y.append(error_of(over_chosen.mean))
            # an interval over two scenes would be so wide that it hides the lines
            interval = over_chosen.interval if len(chosen) > 2 else None
            low.append(None if interval is None else error_of(interval[1]))
            high.append(None if interval is None else error_of(interval[0]))
        yield Series(panel, 0, family, label, ERROR, x, y, low, high)
    if scene is None or axis != "core_seconds":
        return
    of_scene = [cell for cells in frontier.cells.values() for cell in cells if cell.scene == scene]
    for title, name in (("copying the nearest training view", "psnr_floor"), ("noise of the truth", "psnr_ceiling")):
        if known := [score for cell in of_scene if (score := cell.scores.get(name)) is not None]:
            level, ends = error_of(float(np.median(known))), [frontier.budgets[0], frontier.budgets[-1]]
            yield Series(panel, 0, title, label, ERROR, ends, [level, level])
    others = [point for point in points_of(frontier.amount) if point.scene == scene]
    for name in dict.fromkeys(point.name for point in others):
        theirs = [point for point in others if point.name == name]
        seconds, errors = [each.core_seconds for each in theirs], [error_of(each.psnr) for each in theirs]
        yield Series(panel, 0, name, label, ERROR, seconds, errors)


def _decibels(value: float) -> str | None:
    return None if np.isnan(value) else f"{value:.2f}"
