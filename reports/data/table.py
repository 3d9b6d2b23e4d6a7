"""Records → tidy pandas tables: one row per cell, one row per checkpoint, means over seeds."""

from typing import NamedTuple

import pandas as pd

from harness.records.json_record import finite_or_none
from harness.records.metric_table import METRICS
from harness.verdicts.failures import state_of
from reports.data.load import Records

FORWARD_AND_BACKWARD = 3
"""The cost of a training step in forward passes: a backward pass costs two."""
SCORES = (*METRICS, "psnr_train", "psnr_ceiling", "psnr_floor")


class Spread(NamedTuple):
    mean: float | None
    sd: float | None
    """The sample standard deviation; None for fewer than two values."""


def cells_frame(records: Records) -> pd.DataFrame:
    """Return one row per cell, its scores as columns; a missing score is None. A run that ended in empty collapse is
    not `done`: means are of the runs whose differences are judged.
    """
    rows = [
        {
            "scene": cell.scene,
            "method": cell.method,
            "seed": cell.seed,
            "status": state_of(cell),
            **{score: finite_or_none(cell.scores.get(score)) for score in SCORES},
        }
        for cell in records.cells
    ]
    return pd.DataFrame(rows).astype(dict.fromkeys(SCORES, "float64"))


def curves_frame(records: Records) -> pd.DataFrame:
    """Return one row per checkpoint, its costs so far and its scores as columns, in the order of training."""
    rows = [
        {
            "scene": cell.scene,
            "method": cell.method,
            "seed": cell.seed,
            "status": cell.status,
            "step": point.step,
            "seconds": point.seconds,
            "core_seconds": point.core_seconds,
            "rays": _times(point.step, cell.properties.get("rays_per_step")),
            "evaluations": point.network_evaluations,
            "flops": _times(
                FORWARD_AND_BACKWARD * point.network_evaluations, cell.properties.get("flops_per_evaluation")
            ),
            **{name: getattr(point, name) for name in METRICS},
        }
        for cell in records.cells
        for point in sorted(cell.curve, key=lambda point: point.step)
    ]
    numbers = ("seconds", "core_seconds", "rays", "evaluations", "flops", *METRICS)
    columns = ["scene", "method", "seed", "status", "step", *numbers]
    return pd.DataFrame(rows, columns=columns).astype(dict.fromkeys(numbers, "float64"))


def _times(many: int, each: float | str | None) -> float | None:
    return many * float(each) if isinstance(each, int | float) else None


def spread(values: pd.Series) -> Spread:
    known = values.dropna()
    if known.empty:
        return Spread(None, None)
    return Spread(float(known.mean()), float(known.std(ddof=1)) if len(known) > 1 else None)


def spread_of(frame: pd.DataFrame, scene: str, method: str, score: str) -> Spread:
    """Return the spread over the seeds that finished."""
    chosen = frame[(frame["scene"] == scene) & (frame["method"] == method)]
    return spread(chosen.loc[chosen["status"] == "done", score])


def shared_scenes(frame: pd.DataFrame, score: str) -> list[str]:
    """Return the scenes where every method has at least one finished score, over which an average may be taken.

    A method that was not available in any cell has no average, and excludes no scene for the others.
    """
    done = frame[(frame["status"] == "done") & frame[score].notna()]
    methods = set(frame.loc[frame["status"] != "not_available", "method"])
    return [scene for scene, group in done.groupby("scene", sort=False) if set(group["method"]) == methods]


def average_of(frame: pd.DataFrame, method: str, score: str, scenes: list[str]) -> Spread:
    """Return the mean over `scenes` of the means over seeds; its spread is that of seeds finished in all scenes."""
    chosen = frame[(frame["method"] == method) & frame["scene"].isin(scenes)]
    done = chosen[(chosen["status"] == "done") & chosen[score].notna()]
    if done.empty:
        return Spread(None, None)
    by_seed = done.groupby("seed")[score].agg(["mean", "size"])
    over_seeds = spread(by_seed.loc[by_seed["size"] == len(scenes), "mean"])
    return over_seeds._replace(mean=float(done.groupby("scene")[score].mean().mean()))
