"""Cells → paired comparisons, at equal steps and at equal time."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from harness.records import CellRecord, Comparison
from harness.statistics import Verdict, detectable, over_scenes, verdict


@dataclass(frozen=True)
class Metric:
    higher_is_better: bool
    smallest_of_interest: float
    """Differences below it do not matter to anybody; for PSNR the smallest step of the paper's Table 4."""
    along_training: bool
    """Scored at every checkpoint, so that it can be compared at equal time."""


METRICS: dict[str, Metric] = {
    "psnr": Metric(True, 0.2, True),
    "ssim": Metric(True, 0.005, True),
    "rmse_linear": Metric(False, 0.002, True),
    "flip": Metric(False, 0.005, True),
    "delta_e": Metric(False, 0.1, False),
    "depth_rmse": Metric(False, 0.02, True),
    "opacity_iou": Metric(True, 0.005, False),
}

PRIMARY = "psnr"

Budget = Literal["steps", "seconds"]
Key = tuple[str, str, int]


def family_of(metric: str, scene: str, scenes: int, metrics: int = len(METRICS)) -> int:
    """How many comparisons of two methods at one budget are looked at together with this one.

    Declared before any data: PSNR over all scenes is the question itself, and stands alone. PSNR by scene is asked once
    a scene, the other metrics over all scenes once a metric, and by scene as often as both. Methods and budgets are
    questions of their own. `metrics` is how many are looked at, PSNR included.
    """
    by_metric = 1 if metric == PRIMARY else max(1, metrics - (metrics > 1))
    return by_metric * (1 if scene == "all" else scenes)


@dataclass(frozen=True)
class Judgement:
    """A table of paired differences as a verdict sees it."""

    difference: float | None
    interval: tuple[float, float] | None
    simultaneous: tuple[float, float] | None
    smallest_detectable: float | None
    verdict: Verdict
    pairs: int
    left_aside: int


def compare(cells: list[CellRecord], methods: list[str]) -> list[Comparison]:
    """Every method against `nerf` (else the first one), and against `nerf_matched` where it takes part."""
    by_key, scenes, seeds = keyed(cells)
    rows = []
    for method, against in duels(methods):
        for name, metric in METRICS.items():
            budgets: tuple[Budget, ...] = ("steps", "seconds") if metric.along_training else ("steps",)
            for budget in budgets:
                table = differences(by_key, scenes, seeds, method, against, name, budget)
                rows += [_comparison(table, scene, method, against, name, budget) for scene in [*scenes, "all"]]
    return rows


def duels(methods: list[str]) -> list[tuple[str, str]]:
    """Who is compared with whom: (method, against)."""
    references = [
        name for name in dict.fromkeys(["nerf" if "nerf" in methods else methods[0], "nerf_matched"]) if name in methods
    ]
    return [
        (method, against)
        for against in references
        for method in methods
        if method != against and not (method in references and against != references[0])
    ]


def keyed(cells: list[CellRecord]) -> tuple[dict[Key, CellRecord], list[str], list[int]]:
    """Cells by scene, method and seed, with all scenes and all seeds."""
    by_key = {(cell.scene, cell.method, cell.seed): cell for cell in cells}
    return by_key, sorted({cell.scene for cell in cells}), sorted({cell.seed for cell in cells})


def differences(
    cells: dict[Key, CellRecord],
    scenes: list[str],
    seeds: list[int],
    method: str,
    against: str,
    metric: str,
    budget: Budget,
) -> dict[str, np.ndarray]:
    """Scene → `method` − `against` [seeds], NaN where a cell of the pair is missing or has no such score."""
    found = {}
    for scene in scenes:
        pairs = [
            scores_at(cells.get((scene, method, seed)), cells.get((scene, against, seed)), metric, budget)
            for seed in seeds
        ]
        found[scene] = np.array(
            [math.nan if ours is None or theirs is None else ours - theirs for ours, theirs in pairs], dtype=np.float64
        )
    return found


def judged(table: dict[str, np.ndarray], metric: str, family: int) -> Judgement:
    """Scene → differences [seeds], NaN where there is none: over all its scenes, which are the units if many."""
    there = {scene: values for scene, values in table.items() if np.isfinite(values).any()}
    aside = int(sum(np.isnan(values).sum() for values in table.values()))
    if not there:
        return Judgement(None, None, None, None, "inconclusive", 0, aside)
    result = over_scenes(there, family)
    of_interest = METRICS[metric].smallest_of_interest
    said = verdict(result, of_interest, METRICS[metric].higher_is_better)
    return Judgement(
        result.mean,
        result.interval,
        result.simultaneous,
        detectable(result, of_interest),
        # a difference of survivors says nothing of those that did not survive
        "inconclusive" if aside else said,
        int(sum(np.isfinite(values).sum() for values in there.values())),
        aside,
    )


def _comparison(
    table: dict[str, np.ndarray], scene: str, method: str, against: str, metric: str, budget: Budget
) -> Comparison:
    family = family_of(metric, scene, len(table))
    one = judged(table if scene == "all" else {scene: table[scene]}, metric, family)
    return Comparison(
        scene=scene,
        method=method,
        against=against,
        metric=metric,
        budget=budget,
        difference=one.difference,
        interval=one.interval,
        verdict=one.verdict,
        smallest_detectable=one.smallest_detectable,
        pairs=one.pairs,
        left_aside=one.left_aside,
        simultaneous=one.simultaneous,
        family=family,
    )


def scores_at(
    first: CellRecord | None, second: CellRecord | None, name: str, budget: Budget
) -> tuple[float | None, float | None]:
    """A metric of two cells: at the steps that both have done, or at the training time that the quicker one took."""
    if first is None or second is None or first.status != "done" or second.status != "done":
        return None, None
    if budget == "steps" and first.steps == second.steps:
        return first.scores.get(name), second.scores.get(name)
    axis: Literal["step", "seconds"] = "step" if budget == "steps" else "seconds"
    at = min(first.steps, second.steps) if budget == "steps" else min(first.train_seconds, second.train_seconds)
    return score_on_curve(first, name, axis, at), score_on_curve(second, name, axis, at)


def score_on_curve(cell: CellRecord, name: str, axis: Literal["step", "seconds"], at: float) -> float | None:
    """A metric of a cell's curve, linear in the logarithm of steps or seconds between checkpoints.

    None before the first checkpoint, and for a metric that is scored at the end alone.
    """
    points = [
        (getattr(point, axis), value) for point in cell.curve if (value := getattr(point, name, None)) is not None
    ]
    if not points or at < points[0][0]:
        return None
    positions = [math.log(position) for position, _ in points]
    return float(np.interp(math.log(at), positions, [value for _, value in points]))
