"""The same small sweep of optimisers and their settings for every method, on validation views and a seed of its own.

No method may get tuning that the others did not: what a profile sets for all must not be one method's favourite.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import fmean

from baselines.numerics.optimisers import OptimiserName
from harness.plan.profiles import TUNED, Plan
from harness.plan.schedule import Decay
from harness.studies.choices.arms import Arm, CellTask, settings_of, trained_cells

SEED = 1_000
"""A seed that no verdict uses."""
FACTORS = (0.5, 1.0, 2.0)
"""The factors of the rates of each optimiser (`harness.plan.profiles.TUNED`), first and last alike."""
ARMS = (
    *(Arm(optimiser=name, rate=factor) for name in TUNED for factor in FACTORS),
    Arm(optimiser="adam", betas=(0.9, 0.999)),
    Arm(optimiser="soap", betas=(0.95, 0.95)),
    Arm(optimiser="soap", betas=(0.9, 0.999)),
    Arm(optimiser="muon", betas=(0.9, 0.99)),
    *(Arm(optimiser=name, decay="exponential") for name in ("adam", "soap")),
    *(Arm(optimiser=name, covered_share=0.0) for name in ("adam", "soap")),
)
"""Every optimiser at three rates, then one other setting at a time at the middle one."""


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


def sweep(
    plan: Plan, folders: dict[str, Path], scratch: Path, workers: int, device: str, kept: Path | None = None
) -> Iterator[SweepRow]:
    """Train every method in every arm on every scene; decoded images go to `scratch`, a folder on a disk, and finished
    cells to `kept`.

    Raises `InputError` for a view set without validation views.
    """
    arms = {str(number): arm for number, arm in enumerate(ARMS)}
    tasks = [
        CellTask(scene, method, SEED, folder, scratch, plan, arms, device, "val", kept)
        for scene, folder in folders.items()
        for method in plan.methods
    ]
    for cell in trained_cells(tasks, workers):
        for name, arm in arms.items():
            ended = cell.ended[name]
            yield SweepRow(cell.scene, cell.method, tried_in(plan, arm), ended.psnr, ended.core_seconds)


def tried_in(plan: Plan, arm: Arm) -> Tried:
    train = settings_of(plan.train, arm)
    optimiser = train.optimiser
    rates = train.learning_rate, train.last_learning_rate
    return Tried(optimiser.name, *rates, train.decay, optimiser.betas, train.covered_share)


def means(rows: list[SweepRow]) -> dict[Tried, float]:
    """Map settings → the mean over methods and scenes, the best first; a diverged run counts as the worst."""
    scores: dict[Tried, list[float]] = {}
    for row in rows:
        scores.setdefault(row.tried, []).append(-1e3 if row.psnr_val is None else row.psnr_val)
    averaged = {tried: fmean(values) for tried, values in scores.items()}
    return dict(sorted(averaged.items(), key=lambda item: -item[1]))


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
