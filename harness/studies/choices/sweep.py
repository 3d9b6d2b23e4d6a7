"""The same small sweep of the learning rate for every method, on validation views and a seed of its own.

No method may get tuning that the others did not: what a profile sets for all must not be one method's favourite.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch

from harness.execution.ground_truth import read_views
from harness.plan.profiles import Plan
from harness.training.lockstep import psnr_on, stream_of, trained_alone
from harness.training.trainer import Diverged
from scenes.files.errors import InputError
from scenes.view_sets.view_set import ViewSet

SEED = 1_000
"""A seed that no verdict uses."""
FACTORS = (0.25, 0.5, 1.0, 2.0)
"""The factors of the profile's learning rates, first and last alike."""


@dataclass(frozen=True)
class SweepRow:
    """The mean PSNR on the validation views of one scene after the profile's budget; None if training diverged."""

    scene: str
    method: str
    learning_rate: float
    psnr_val: float | None


def sweep(plan: Plan, folders: dict[str, Path], device: torch.device, scratch: Path) -> Iterator[SweepRow]:
    """Train every method at every learning rate on every scene; decoded images go to `scratch`, a folder on a disk."""
    view_sets = {scene: read_views(folder, plan.views, scratch, scored_on="val") for scene, folder in folders.items()}
    for views in view_sets.values():
        if not views.val.names:
            raise InputError(f"{views.path}: has no validation views (transforms_val.json), which a sweep scores on")
    for scene, views in view_sets.items():
        for method in plan.methods:
            for factor in FACTORS:
                yield _row(plan, views, scene, method, factor, device)


def best_rates(rows: list[SweepRow]) -> dict[str, float]:
    """Return for each method the learning rate with the best mean over scenes; a diverged run counts as the worst."""
    best: dict[str, float] = {}
    for method in dict.fromkeys(row.method for row in rows):
        sums: dict[float, float] = {}
        for row in rows:
            if row.method == method:
                score = -1e3 if row.psnr_val is None else row.psnr_val
                sums[row.learning_rate] = sums.get(row.learning_rate, 0.0) + score
        best[method] = max(sums, key=lambda rate: sums[rate])
    return best


def as_json(rows: list[SweepRow], plan: Plan) -> dict[str, object]:
    return {"seed": SEED, "settings": plan.settings(), "rows": [asdict(row) for row in rows], "best": best_rates(rows)}


def _row(plan: Plan, views: ViewSet, scene: str, method: str, factor: float, device: torch.device) -> SweepRow:
    rates = (plan.train.learning_rate * factor, plan.train.last_learning_rate * factor)
    settings = replace(plan.train, learning_rate=rates[0], last_learning_rate=rates[1])
    try:
        trainer = trained_alone(method, views, stream_of(scene, SEED), settings, plan.budget, device)
        return SweepRow(scene, method, rates[0], psnr_on(trainer, views, views.val, plan.score.chunk))
    except Diverged:
        return SweepRow(scene, method, rates[0], None)
