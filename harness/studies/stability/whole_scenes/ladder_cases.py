"""L1: the rung of each ladder at which a method breaks.

A method breaks if it has no scores (diverged, failed) or explains less than half of the variance of the picture. Where
the appearance of a surface is hard, the variance is that within its silhouette, which every method learns; where the
shape is hard, that of complete views. A score below a copy of the nearest training view is reported but does not count
as broken: a ball of fog looks the same from every side, and its copies are perfect.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from harness.records.cells import CellRecord
from harness.records.study import Check, Series, check
from harness.studies.framework import Found
from harness.studies.stability.stability_context import StabilityContext, owner_of_method
from harness.studies.stability.whole_scenes import scene_truth
from harness.studies.stability.whole_scenes.scene_truth import SceneRun
from scenes.catalog.ladders.ladders import LADDERS, Ladder
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import ViewSet

ITEM = 9
PROFILE = "ladder"
ENOUGH = 0.5
"""The share of the variance below which a method counts as broken."""
LOOKS = ("frequency", "dynamic_range")
"""The ladders whose difficulty lies within the silhouette."""
LEAST_RUNGS = {"frequency": 1, "thinness": 2, "density": 5, "dynamic_range": 1, "scale": 5}
"""The rungs that a method of this harness must climb: every rung of the control and of the fog."""


class RungScore(NamedTuple):
    share: float | None
    broken: str
    """The reason why the method counts as broken; empty if it does not."""


def ladders(context: StabilityContext) -> Iterator[Found]:
    names = [scene for ladder in LADDERS.values() for scene in ladder.scenes]
    run = scene_truth.trained(context, PROFILE, names, context.out / "ladders")
    for ladder in LADDERS.values():
        values = list(ladder.values)
        sets = [run.view_set(context, scene) for scene in ladder.scenes]
        noise = [0.0 if views.test.noise_mse is None else float(np.mean(views.test.noise_mse)) for views in sets]
        ceilings = [share_of_views(mse, views) for mse, views in zip(noise, sets, strict=True)]
        yield _line(ladder, "limit by noise of the ground truth", values, ceilings)
        for method in run.run.methods:
            climbed = [
                worst([score_of(run, cell, views, ladder.name in LOOKS) for cell in run.cells[scene, method]])
                for scene, views in zip(ladder.scenes, sets, strict=True)
            ]
            shares = {x: rung.share for x, rung in zip(values, climbed, strict=True) if rung.share is not None}
            if shares:
                yield _line(ladder, method, list(shares), list(shares.values()))
            yield outcome_of(ladder, run, method, climbed)
        yield _line(ladder, "half explained", values, [ENOUGH] * len(values))


def score_of(run: SceneRun, cell: CellRecord, views: ViewSet, looks: bool) -> RungScore:
    """Score a method on complete test views or, with `looks`, within the silhouette of the stored renders."""
    if cell.status != "done":
        return RungScore(None, f"{cell.status}: {cell.reason}")
    if looks:
        share = scene_truth.share_of_looks(run, cell, views)
    else:
        mse = scene_truth.mse_over_tests(cell)
        share = None if mse is None else share_of_views(mse, views)
    if share is None:
        return RungScore(None, "its record holds no score")
    return RungScore(share, f"explains {share:.0%}" if share < ENOUGH else "")


def share_of_views(mse: float, views: ViewSet) -> float:
    """Return the share of the variance of complete test views that a mean square error leaves explained."""
    pixels = np.concatenate([over_white(rgba).reshape(-1, 3) for rgba in views.test.rgba])
    return 1.0 - mse / scene_truth.colour_variance(pixels)


def worst(of_seeds: list[RungScore]) -> RungScore:
    """Return the worst seed: one without a score, else that with the smallest share."""
    return min(of_seeds, key=lambda score: (score.share is not None, score.share or 0.0))


def rungs_climbed(scores: list[RungScore]) -> int:
    return next((place for place, score in enumerate(scores) if score.broken), len(scores))


def _line(ladder: Ladder, name: str, x: list[float], explained: list[float]) -> Series:
    """Return the unexplained share, on a logarithmic axis: it may exceed 1 by far."""
    panel, label = f"{ladder.name}: {ladder.title}", "share of variance not explained"
    order = np.argsort(x)  # the ladder of scales is not monotonic
    return Series(panel, ITEM, name, ladder.unit, label, [x[i] for i in order], [1.0 - explained[i] for i in order])


def outcome_of(ladder: Ladder, run: SceneRun, method: str, climbed: list[RungScore]) -> Check:
    what, owner = f"{ladder.name}: rungs climbed of {len(climbed)}", owner_of_method(method)
    first = run.cells[ladder.scenes[0], method][0]
    if first.status == "not_available":
        return Check(what, None, why=first.reason or "", subject=method, owner=owner, status="not_available")
    count = rungs_climbed(climbed)
    why = f"at {ladder.values[count]:g} {ladder.unit} it {climbed[count].broken}" if count < len(climbed) else ""
    return check(what, float(count), low=float(LEAST_RUNGS[ladder.name]), why=why, subject=method, owner=owner)
