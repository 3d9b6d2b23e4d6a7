"""The same small sweep of optimisers and their settings for every method, on validation views with a separate seed.

No method may be tuned more than the others: what a profile sets for all must not favour one of them.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from baselines.numerics.optimisers import OptimiserName
from harness.plan.profiles import TUNED
from harness.plan.run_plan import Plan
from harness.plan.schedule import Decay
from harness.studies.choices.arms import Arm, CellTask, Ended, means_of, trained_cells

SEED = 1_000
FACTORS = (0.5, 1.0, 2.0)
"""The factors of each optimiser's first and last learning rate (`harness.plan.profiles.TUNED`)."""


def _tuned(name: OptimiserName, rate: float = 1.0, betas: tuple[float, float] | None = None, **others: Any) -> Arm:
    train = {**TUNED[name], **others}
    train |= {rates: train[rates] * rate for rates in ("learning_rate", "last_learning_rate")}
    if betas is not None:
        train["optimiser"] = replace(train["optimiser"], betas=betas)
    return Arm(train)


ARMS = (
    *(_tuned(name, factor) for name in TUNED for factor in FACTORS),
    _tuned("adam", betas=(0.9, 0.999)),
    _tuned("soap", betas=(0.95, 0.95)),
    _tuned("soap", betas=(0.9, 0.999)),
    _tuned("muon", betas=(0.9, 0.99)),
    *(_tuned(name, decay="exponential") for name in ("adam", "soap")),
    *(_tuned(name, covered_share=0.0) for name in ("adam", "soap")),
)
"""Every optimiser at three rates, then one other setting at a time at the middle rate."""


@dataclass(frozen=True)
class Tried:
    optimiser: OptimiserName
    learning_rate: float
    last_learning_rate: float
    decay: Decay
    betas: tuple[float, float]
    covered_share: float


@dataclass(frozen=True)
class SweepRow:
    """The mean PSNR on the validation views of one scene after the profile's budget; None if training diverged."""

    scene: str
    method: str
    tried: Tried
    psnr_val: float | None
    core_seconds: float


def try_arms(
    plan: Plan,
    arms_of: Callable[[str], Mapping[str, Arm]],
    folders: dict[str, Path],
    scratch: Path,
    workers: int,
    device: str,
    kept: Path | None = None,
) -> Iterator[tuple[str, str, str, Ended]]:
    """Train every method of `plan` in each of its arms on every scene, with a seed that no verdict uses; yield method,
    arm, scene and the result on validation views. Raises `InputError` for a view set without them.
    """
    tasks = [
        CellTask(scene, method, SEED, folder, scratch, plan, {name: arm}, device, "val", kept)
        for method in plan.methods
        for name, arm in arms_of(method).items()
        for scene, folder in folders.items()
    ]
    for cell in trained_cells(tasks, workers):
        yield from ((cell.method, name, cell.scene, ended) for name, ended in cell.ended.items())


def sweep(
    plan: Plan, folders: dict[str, Path], scratch: Path, workers: int, device: str, kept: Path | None = None
) -> Iterator[SweepRow]:
    arms = {str(number): arm for number, arm in enumerate(ARMS)}
    for method, name, scene, ended in try_arms(plan, lambda method: arms, folders, scratch, workers, device, kept):
        yield SweepRow(scene, method, tried_in(plan, arms[name]), ended.psnr, ended.core_seconds)


def tried_in(plan: Plan, arm: Arm) -> Tried:
    train = replace(plan.train, **arm.train)
    optimiser = train.optimiser
    rates = train.learning_rate, train.last_learning_rate
    return Tried(optimiser.name, *rates, train.decay, optimiser.betas, train.covered_share)


def means(rows: list[SweepRow]) -> dict[Tried, float | None]:
    """Map settings → the mean over methods and scenes, the best first; a diverged run counts as the worst."""
    return means_of((row.tried, -1e3 if row.psnr_val is None else row.psnr_val) for row in rows)


def best_of_each(rows: list[SweepRow]) -> dict[str, Tried]:
    methods = dict.fromkeys(row.method for row in rows)
    return {method: next(iter(means([row for row in rows if row.method == method]))) for method in methods}


def as_json(rows: list[SweepRow], plan: Plan) -> dict[str, object]:
    return {
        "seed": SEED,
        "settings": plan.settings(),
        "rows": [asdict(row) for row in rows],
        "means": [{**asdict(tried), "psnr_val": mean} for tried, mean in means(rows).items()],
        "best": {method: asdict(tried) for method, tried in best_of_each(rows).items()},
    }
