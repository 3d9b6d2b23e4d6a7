"""How much sooner one method reaches a score than another: the measure of the paper's Table 3."""

import math

import pandas as pd


def savings(curves: pd.DataFrame, axis: str, target: float) -> list[float]:
    """By how many per cent qnerf reaches the target sooner than nerf, seed by seed.

    Empty unless both reach it in every seed, on the mean over all scenes.
    """
    scenes = curves["scene"].nunique()
    found = []
    for _, of_seed in curves.groupby("seed"):
        baseline, method = (
            reached_at(of_seed[of_seed["method"] == name], scenes, axis, target) for name in ("nerf", "qnerf")
        )
        if baseline is None or method is None:
            return []
        found.append(100 * (1 - method / baseline))
    return found


def reached_at(curves: pd.DataFrame, scenes: int, axis: str, target: float) -> float | None:
    """Where the mean over scenes first crosses the target, between checkpoints on a line over the log axis.

    None where it never does, or already has at the first checkpoint: when, nobody knows then.
    """
    by_step = curves.dropna(subset=["psnr"]).groupby("step")
    points = by_step.agg(psnr=("psnr", "mean"), seconds=("seconds", "mean"), many=("scene", "nunique")).reset_index()
    before: tuple[float, float] | None = None
    for row in points[points["many"] == scenes].to_dict("records"):
        at = float(row[axis])
        if row["psnr"] >= target:
            if before is None or before[0] <= 0:
                return None
            share = (target - before[1]) / (row["psnr"] - before[1])
            return math.exp(math.log(before[0]) + share * (math.log(at) - math.log(before[0])))
        before = (at, row["psnr"])
    return None
