"""Cells → paired comparisons, at equal steps and at equal time."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from harness.records import CellRecord, Comparison
from harness.statistics import over_scenes, paired_difference, verdict


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

Key = tuple[str, str, int]


def compare(cells: list[CellRecord], methods: list[str]) -> list[Comparison]:
    """Every method against `nerf` (else the first one), and against `nerf_matched` where it takes part."""
    by_key = {(cell.scene, cell.method, cell.seed): cell for cell in cells}
    scenes = sorted({cell.scene for cell in cells})
    seeds = sorted({cell.seed for cell in cells})
    references = [
        name for name in dict.fromkeys(["nerf" if "nerf" in methods else methods[0], "nerf_matched"]) if name in methods
    ]
    rows = []
    for against in references:
        for method in methods:
            if method == against or (method in references and against != references[0]):
                continue
            for name, metric in METRICS.items():
                rows += _rows(by_key, scenes, seeds, method, against, name, metric, "steps")
                if metric.along_training:
                    rows += _rows(by_key, scenes, seeds, method, against, name, metric, "seconds")
    return rows


def _rows(
    cells: dict[Key, CellRecord],
    scenes: list[str],
    seeds: list[int],
    method: str,
    against: str,
    name: str,
    metric: Metric,
    budget: Literal["steps", "seconds"],
) -> list[Comparison]:
    differences: dict[str, np.ndarray] = {}
    aside: dict[str, int] = {}
    for scene in scenes:
        found = []
        for seed in seeds:
            pair = [cells.get((scene, one, seed)) for one in (method, against)]
            ours, theirs = scores_at(pair[0], pair[1], name, budget)
            if ours is None or theirs is None:
                aside[scene] = aside.get(scene, 0) + 1
            else:
                found.append(ours - theirs)
        if found:
            differences[scene] = np.array(found)
    rows = []
    for scene in [*scenes, "all"]:
        chosen = differences if scene == "all" else {key: value for key, value in differences.items() if key == scene}
        left_aside = sum(aside.values()) if scene == "all" else aside.get(scene, 0)
        pairs = sum(len(values) for values in chosen.values())
        common = (scene, method, against, name, budget)
        if not chosen:
            rows.append(Comparison(*common, None, None, "inconclusive", None, 0, left_aside))
            continue
        result = over_scenes(chosen) if scene == "all" else paired_difference(chosen[scene])
        said = verdict(result, metric.smallest_of_interest, metric.higher_is_better)
        # a difference of survivors says nothing of those that did not survive
        said = "inconclusive" if left_aside else said
        rows.append(
            Comparison(*common, result.mean, result.interval, said, result.smallest_detectable, pairs, left_aside)
        )
    return rows


def scores_at(
    first: CellRecord | None, second: CellRecord | None, name: str, budget: Literal["steps", "seconds"]
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
