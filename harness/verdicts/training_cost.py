"""What training costs: core seconds of a method as a multiple of the baseline's."""

from dataclasses import dataclass

import numpy as np

from harness.records.cells import CellRecord
from harness.verdicts.comparisons import judged, keyed


@dataclass(frozen=True)
class CostRatio:
    """Core seconds of a method over those of the baseline in the same scene and seed, for the same number of steps."""

    method: str
    ratio: float | None
    """The geometric mean; None for the baseline, and where no pair did the same number of steps."""
    interval: tuple[float, float] | None
    """95 %: on scenes like these if there are several, else over the seeds of the one."""


def cost_ratios(cells: list[CellRecord], methods: list[str], against: str) -> list[CostRatio]:
    """Return one row per method, as a multiple of `against`.

    Wall seconds take the place of core seconds where a pair did not count these.
    """
    by_key, scenes, seeds = keyed(cells)

    def log_ratio(scene: str, method: str, seed: int) -> float:
        ours, theirs = by_key.get((scene, method, seed)), by_key.get((scene, against, seed))
        if ours is None or theirs is None or (ours.status, theirs.status) != ("done", "done"):
            return np.nan
        spent = ours.train_core_seconds, theirs.train_core_seconds
        first, second = (ours.train_seconds, theirs.train_seconds) if None in spent else spent
        if ours.steps != theirs.steps or not first or not second:
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
