"""The same small sweep of the learning rate for every method, on validation views and a seed of its own.

No method may get tuning that the others did not: what a profile sets for all must not be one method's favourite.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from harness.plan.profiles import Plan
from harness.studies.choices.arms import Arm, CellTask, trained_cells

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


def sweep(plan: Plan, folders: dict[str, Path], scratch: Path, workers: int, device: str) -> Iterator[SweepRow]:
    """Train every method at every learning rate on every scene; decoded images go to `scratch`, a folder on a disk.

    Raises `InputError` for a view set without validation views.
    """
    arms = {f"{factor:g} of the rate": Arm(rate=factor) for factor in FACTORS}
    tasks = [
        CellTask(scene, method, SEED, folder, scratch, plan, arms, device, "val")
        for scene, folder in folders.items()
        for method in plan.methods
    ]
    for cell in trained_cells(tasks, workers):
        for name, arm in arms.items():
            yield SweepRow(cell.scene, cell.method, plan.train.learning_rate * arm.rate, cell.ended[name].psnr)


def best_rates(rows: list[SweepRow]) -> dict[str, float]:
    """Return for each method the learning rate with the best mean over scenes; a diverged run counts as the worst."""
    sums: dict[str, dict[float, float]] = defaultdict(lambda: defaultdict(float))
    for row in rows:
        sums[row.method][row.learning_rate] += -1e3 if row.psnr_val is None else row.psnr_val
    return {method: max(rates, key=lambda rate: rates[rate]) for method, rates in sums.items()}


def as_json(rows: list[SweepRow], plan: Plan) -> dict[str, object]:
    return {"seed": SEED, "settings": plan.settings(), "rows": [asdict(row) for row in rows], "best": best_rates(rows)}
