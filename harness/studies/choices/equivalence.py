"""What a single change does to final scores: pairs of cells that differ only in it, with the same rays and weights.

Accelerations that sum in another order need no such test. Two change what is summed: an occupancy grid leaves points
out (for Listing 2, whose mean runs over the points of the chunk, this also changes the density of the others), and
reduced precision rounds. Scores show the effect.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from harness.plan.run_plan import Plan
from harness.records.json_record import plain
from harness.records.verdict import OPEN, verdict_of
from harness.studies.choices.arms import PLANNED, Arm, CellArms, CellTask, trained_cells, weigh

Change = Literal["grid", "precision"]
SMALLEST_OF_INTEREST_DB = 0.2
"""The smallest difference of interest, as in all verdicts of the harness."""


@dataclass(frozen=True)
class ScorePair:
    """The mean test PSNR of two cells; None if training diverged."""

    scene: str
    method: str
    seed: int
    change: Change
    psnr: float | None
    psnr_changed: float | None


def arms_of(plan: Plan, changes: list[Change]) -> dict[str, Arm]:
    """Return the arms: as planned, and with each change (without the grid, or with the other precision)."""
    other: dict[Change, Arm] = {
        "grid": Arm(need=("empty_space",)),
        "precision": Arm({"precision": "bfloat16" if plan.train.precision == "float32" else "float32"}),
    }
    return {PLANNED: Arm()} | {change: other[change] for change in changes}


def pairs(
    plan: Plan,
    changes: list[Change],
    folders: dict[str, Path],
    scratch: Path,
    workers: int,
    kept: Path | None = None,
) -> Iterator[ScorePair]:
    arms = arms_of(plan, changes)
    tasks = [
        CellTask(scene, method, seed, folders[scene], scratch, plan, arms, kept=kept)
        for scene, method, seed in plan.cells()
    ]
    for cell in trained_cells(tasks, workers):
        yield from pairs_of(cell, changes)


def pairs_of(cell: CellArms, changes: list[Change]) -> Iterator[ScorePair]:
    for change in changes:
        scores = cell.ended[PLANNED].psnr, cell.ended[change].psnr
        yield ScorePair(cell.scene, cell.method, cell.seed, change, *scores)


def as_json(rows: list[ScorePair], plan: Plan) -> dict[str, object]:
    """Return the pairs, and for each change and method the mean difference with its interval and verdict."""
    return {
        "what": "test PSNR with a change minus test PSNR as planned, paired over cells; smaller than "
        f"matters: 95 % interval within ±{SMALLEST_OF_INTEREST_DB} dB",
        "settings": plan.settings(),
        "summary": [
            _summary([row for row in rows if (row.change, row.method) == (change, method)])
            for change in dict.fromkeys(row.change for row in rows)
            for method in plan.methods
        ],
        "pairs": [asdict(row) for row in rows],
    }


def _summary(rows: list[ScorePair]) -> dict[str, object]:
    result = weigh((row.psnr_changed, row.psnr) for row in rows)
    both = [(row.psnr_changed, row.psnr) for row in rows if row.psnr_changed is not None and row.psnr is not None]
    return {
        "change": rows[0].change,
        "method": rows[0].method,
        "pairs": len(both),
        "diverged": len(rows) - len(both),
        "difference": result.mean if result else None,
        "interval": result.interval if result else None,
        "largest": max((abs(changed - planned) for changed, planned in both), default=None),
        "verdict": plain(verdict_of(result.simultaneous, SMALLEST_OF_INTEREST_DB) if result else OPEN),
    }
