"""What switching one thing off does to final scores: pairs of cells that differ in it alone, same rays, same weights.

Accelerations that sum in another order need no such test. Two do change what is summed: an occupancy grid leaves points
out (for Listing 2, whose mean runs over the points of the chunk, this also changes the density of those that stay), and
reduced precision rounds. Whether that matters is a question of scores.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from harness.plan.profiles import Plan
from harness.studies.choices.arms import Arm, CellArms, CellTask, trained_cells

Change = Literal["grid", "precision"]
SMALLEST_OF_INTEREST_DB = 0.2
"""The smallest difference of interest, as in every verdict of the harness."""
PLANNED = "as planned"


@dataclass(frozen=True)
class ScorePair:
    """The mean test PSNR of both; None if training diverged."""

    scene: str
    method: str
    seed: int
    change: Change
    psnr: float | None
    psnr_changed: float | None
    psnr_same_weights: float | None
    """The score of the weights that were trained with the grid, rendered without it; None for other changes."""


def arms_of(plan: Plan, changes: list[Change]) -> dict[str, Arm]:
    """Return the arms: as planned, and with each change, which is no grid or the other precision."""
    other: dict[Change, Arm] = {
        "grid": Arm(need=("empty_space",)),
        "precision": Arm(precision="bfloat16" if plan.train.precision == "float32" else "float32"),
    }
    planned = Arm(rendered_with=("empty_space",) if "grid" in changes else ())
    return {PLANNED: planned} | {change: other[change] for change in changes}


def pairs(
    plan: Plan, changes: list[Change], folders: dict[str, Path], scratch: Path, workers: int
) -> Iterator[ScorePair]:
    """Yield all cells of the plan with each change, on `workers` processes of one thread; decoded images go to
    `scratch`.
    """
    arms = arms_of(plan, changes)
    tasks = [CellTask(scene, method, seed, folders[scene], scratch, plan, arms) for scene, method, seed in plan.cells()]
    for cell in trained_cells(tasks, workers):
        yield from pairs_of(cell, changes)


def pairs_of(cell: CellArms, changes: list[Change]) -> list[ScorePair]:
    planned = cell.ended[PLANNED]
    again = planned.rerendered.get("empty_space")
    return [
        ScorePair(
            cell.scene,
            cell.method,
            cell.seed,
            change,
            planned.psnr,
            cell.ended[change].psnr,
            again.psnr if again is not None and change == "grid" else None,
        )
        for change in changes
    ]


def as_json(found: list[ScorePair], plan: Plan) -> dict[str, Any]:
    """Return the pairs, and for each change and method the mean difference with its interval and verdict."""
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


def _summary(found: list[ScorePair], change: Change, method: str) -> dict[str, Any]:
    from harness.verdicts.statistics import paired_difference, verdict

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
