"""What switching one thing off does to final scores: pairs of cells that differ in it alone, same rays, same weights.

Accelerations that sum in another order need no such test. Two do change what is summed: an occupancy grid leaves
points out (for Listing 2, whose mean runs over the points of the call, this also changes the density of those that
stay), and reduced precision rounds. Whether that matters is a question of scores.
"""

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from harness.plan import Plan
from harness.settings import TrainSettings

Change = Literal["grid", "precision"]
SMALLEST_OF_INTEREST_DB = 0.2
"""As in every verdict of the harness."""


@dataclass(frozen=True)
class PairTask:
    """One cell, to be trained as planned and once more with the change."""

    scene: str
    method: str
    seed: int
    change: Change
    view_set: Path
    scratch: Path
    plan: Plan


@dataclass(frozen=True)
class Pair:
    """Mean test PSNR of both; None where training diverged."""

    scene: str
    method: str
    seed: int
    change: Change
    psnr: float | None
    psnr_changed: float | None
    psnr_same_weights: float | None
    """The weights that were trained with the grid, rendered without it; None for other changes."""


def changed(train: TrainSettings, change: Change) -> TrainSettings:
    """`train` without the grid, or in the other precision."""
    if change == "grid":
        return replace(train, accelerations=replace(train.accelerations, grid=False))
    return replace(train, precision="bfloat16" if train.precision == "float32" else "float32")


def pairs(plan: Plan, changes: list[Change], folders: dict[str, Path], scratch: Path, workers: int) -> Iterator[Pair]:
    """All cells of the plan with each change, on `workers` processes of one thread; decoded images go to `scratch`."""
    tasks = [
        PairTask(scene, method, seed, change, folders[scene], scratch, plan)
        for change in changes
        for scene, method, seed in plan.cells()
    ]
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(trained_pair, tasks)


def trained_pair(task: PairTask) -> Pair:
    """Trains both cells of a pair."""
    import torch

    from harness import evaluate
    from harness.batches import Batches
    from harness.device import keep_freed_memory, use_threads
    from harness.ground_truth import read_views
    from harness.learner import Learner, learner_for
    from harness.lockstep import box_of, needs_view_direction, stream_of
    from harness.trainer import Diverged

    use_threads(1)
    keep_freed_memory()
    plan, device = task.plan, torch.device("cpu")
    views = read_views(task.view_set, plan.views, task.scratch)
    stream = stream_of(task.scene, task.seed)
    batches = Batches(evaluate.cameras_of(views, views.train, device), views.train.rgba)
    test = evaluate.cameras_of(views, views.test, device)

    def score(trainer: Learner) -> float | None:
        return evaluate.quick_scores(evaluate.render_split(trainer, test, plan.score.chunk), views.test)["psnr"]

    def trained(settings: TrainSettings) -> Learner | None:
        trainer = learner_for(
            task.method, box_of(views, device), settings, plan.budget, stream, device, needs_view_direction(views)
        )
        try:
            while trainer.progress < 1.0:
                trainer.train_on(*batches.batch(stream, trainer.step, settings.rays))
        except Diverged:
            return None
        return trainer

    first, second = trained(plan.train), trained(changed(plan.train, task.change))
    psnr = None if first is None else score(first)
    same_weights = None
    if first is not None and task.change == "grid":
        first.grid = None
        same_weights = score(first)
    return Pair(
        task.scene,
        task.method,
        task.seed,
        task.change,
        psnr,
        None if second is None else score(second),
        same_weights,
    )


def as_json(found: list[Pair], plan: Plan) -> dict[str, Any]:
    """The pairs, and for each change and method the mean difference with its interval and verdict."""
    return {
        "what": "test PSNR with a change minus test PSNR as planned, paired over cells; equivalent: 95 % interval "
        f"within ±{SMALLEST_OF_INTEREST_DB} dB",
        "settings": plan.settings(),
        "summary": [
            _summary(found, change, method)
            for change in dict.fromkeys(one.change for one in found)
            for method in plan.methods
        ],
        "pairs": [asdict(one) for one in found],
    }


def _summary(found: list[Pair], change: Change, method: str) -> dict[str, Any]:
    from harness.statistics import paired_difference, verdict

    chosen = [one for one in found if one.change == change and one.method == method]
    differences = [b - a for one in chosen if (a := one.psnr) is not None and (b := one.psnr_changed) is not None]
    rendered = [b - a for one in chosen if (a := one.psnr) is not None and (b := one.psnr_same_weights) is not None]
    result = paired_difference(np.array(differences)) if differences else None
    return {
        "change": change,
        "method": method,
        "pairs": len(differences),
        "diverged": len(chosen) - len(differences),
        "difference": result.mean if result else None,
        "interval": result.interval if result else None,
        "largest": max(map(abs, differences)) if differences else None,
        "verdict": verdict(result, SMALLEST_OF_INTEREST_DB, higher_is_better=True) if result else "inconclusive",
        "same_weights_largest": max(map(abs, rendered)) if rendered else None,
    }
