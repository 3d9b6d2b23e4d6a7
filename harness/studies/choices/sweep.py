"""The same small sweep of optimisers and learning rates for every method, on validation views and a seed of its own.

No method may get tuning that the others did not: what a profile sets for all must not be one method's favourite.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from baselines.numerics.optimisers import OptimiserName
from harness.plan.profiles import TUNED, Plan
from harness.studies.choices.arms import Arm, CellTask, trained_cells

SEED = 1_000
"""A seed that no verdict uses."""
FACTORS = (0.5, 1.0, 2.0)
"""The factors of the rates of each optimiser (`harness.plan.profiles.TUNED`), first and last alike."""
RATES = [(name, factor, None) for name in TUNED for factor in FACTORS]
ANYWHERE: list[tuple[OptimiserName, float, float]] = [("adam", 1.0, 0.0), ("soap", 1.0, 0.0)]
ARMS: dict[tuple[OptimiserName, float, float | None], Arm] = {
    (name, factor, share): Arm(optimiser=name, rate=factor, covered_share=share)
    for name, factor, share in (*RATES, *ANYWHERE)
}
"""Map (optimiser, factor, share of the rays through covered pixels) → the arm; None: the share as planned."""


@dataclass(frozen=True)
class SweepRow:
    """The mean PSNR on the validation views of one scene after the profile's budget; None if training diverged."""

    scene: str
    method: str
    optimiser: OptimiserName
    learning_rate: float
    covered_share: float
    psnr_val: float | None
    core_seconds: float


def sweep(plan: Plan, folders: dict[str, Path], scratch: Path, workers: int, device: str) -> Iterator[SweepRow]:
    """Train every method in every arm on every scene; decoded images go to `scratch`, a folder on a disk.

    Raises `InputError` for a view set without validation views.
    """
    arms = {str(key): arm for key, arm in ARMS.items()}
    tasks = [
        CellTask(scene, method, SEED, folder, scratch, plan, arms, device, "val")
        for scene, folder in folders.items()
        for method in plan.methods
    ]
    for cell in trained_cells(tasks, workers):
        for key in ARMS:
            (name, factor, share), ended = key, cell.ended[str(key)]
            rate = TUNED[name]["learning_rate"] * factor
            share = plan.train.covered_share if share is None else share
            yield SweepRow(cell.scene, cell.method, name, rate, share, ended.psnr, ended.core_seconds)


def means(rows: list[SweepRow], share: float) -> dict[tuple[str, float], float]:
    """Map (optimiser, rate) → its mean over methods and scenes at that share of covered rays, the best first; a
    diverged run counts as the worst.
    """
    scores: dict[tuple[str, float], list[float]] = defaultdict(list)
    for row in rows:
        if row.covered_share == share:
            scores[row.optimiser, row.learning_rate].append(-1e3 if row.psnr_val is None else row.psnr_val)
    averaged = {key: sum(values) / len(values) for key, values in scores.items()}
    return dict(sorted(averaged.items(), key=lambda item: -item[1]))


def best_rates(rows: list[SweepRow]) -> dict[str, dict[str, float]]:
    """Map method → optimiser → the learning rate with the best mean over scenes."""
    best: dict[str, dict[str, float]] = {}
    for method in dict.fromkeys(row.method for row in rows):
        mine = [row for row in rows if row.method == method]
        ranked = means(mine, max(row.covered_share for row in mine))
        best[method] = {name: rate for name, rate in reversed(ranked)}
    return best


def as_json(rows: list[SweepRow], plan: Plan) -> dict[str, object]:
    ranked = means(rows, plan.train.covered_share)
    return {
        "seed": SEED,
        "settings": plan.settings(),
        "rows": [asdict(row) for row in rows],
        "means": [
            {"optimiser": name, "learning_rate": rate, "psnr_val": mean} for (name, rate), mean in ranked.items()
        ],
        "best": best_rates(rows),
    }
