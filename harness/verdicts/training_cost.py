"""The cost of training: core seconds of a method as a multiple of the baseline's."""

from dataclasses import dataclass

import numpy as np

from harness.records.cells import CellRecord
from harness.verdicts.comparisons import judged, keyed


@dataclass(frozen=True)
class CostRatio:
    """A method's core seconds divided by the baseline's, on the same scene and seed, for the same number of steps."""

    method: str
    ratio: float | None
    """The geometric mean; None for the baseline, and if no pair did the same number of steps."""
    interval: tuple[float, float] | None
    """The 95 % interval, for scenes like these if there are several, else over the seeds of the only scene."""


def cost_ratios(cells: list[CellRecord], methods: list[str], against: str) -> list[CostRatio]:
    """Return one row per method, as a multiple of `against`; pairs without core seconds use wall seconds."""
    by_key, scenes, seeds = keyed(cells)

    def log_ratio(scene: str, method: str, seed: int) -> float:
        cell, other = by_key.get((scene, method, seed)), by_key.get((scene, against, seed))
        if cell is None or other is None or (cell.status, other.status) != ("done", "done"):
            return np.nan
        spent = cell.train_core_seconds, other.train_core_seconds
        first, second = (cell.train_seconds, other.train_seconds) if None in spent else spent
        if cell.steps != other.steps or not first or not second:
            return np.nan
        return float(np.log(first / second))

    def of_method(method: str) -> CostRatio:
        if method == against:
            return CostRatio(method, None, None)
        table = {scene: np.array([log_ratio(scene, method, seed) for seed in seeds]) for scene in scenes}
        mean = judged(table, "psnr", family=1)
        if mean.difference is None:
            return CostRatio(method, None, None)
        ends = mean.chosen.interval
        return CostRatio(
            method,
            float(np.exp(mean.difference)),
            None if ends is None else (float(np.exp(ends[0])), float(np.exp(ends[1]))),
        )

    return [of_method(method) for method in methods]
