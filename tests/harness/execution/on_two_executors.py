"""Tiny groups of cells, what an executor tells of them, and results that are the same on every executor."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from harness.execution.group_loop import Event
from harness.execution.local_executor import run_locally
from harness.execution.submitit_executor import FOLDER
from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.plan.settings import ScoreSettings
from harness.records.cells import read_cells
from tests.harness.cells import without_time
from tests.harness.tiny import TRAIN, VIEWS
from tests.replacing import replace

SLOW_SCORES = ScoreSettings(checkpoints=2, earliest=0.5, chunk=24, train_views=10, stored_views=1)
"""Scoring takes a second, long enough to kill a node between two cells of a group."""
COMMIT = "0123456789ab"


def tasks(ball_folder: Path, out: Path, seeds: int, score: ScoreSettings, **changes: Any) -> list[GroupTask]:
    task = GroupTask("ball", 0, ("nerf", "qnerf"), TRAIN, score, Budget(24, None), out, ball_folder, VIEWS)
    return [replace(task, seed=seed, **changes) for seed in range(seeds)]


class Told:
    """What events say: the cells that ended, the notices, and by seed the trained shares."""

    def __init__(self, events: Sequence[Event]) -> None:
        self.cells = sorted((event.cell.method, event.cell.seed) for event in events if event.cell is not None)
        self.notices = [event.notice for event in events if event.notice is not None]
        self.shares: dict[int, list[float]] = {}
        for event in events:
            if event.share is not None:
                self.shares.setdefault(event.task.seed, []).append(event.share)


def files_of(out: Path) -> dict[str, bytes]:
    """Return the files without clocks: weights and pictures."""
    files = {file.relative_to(out): file for file in out.rglob("*") if file.is_file() and file.suffix != ".json"}
    return {name.as_posix(): file.read_bytes() for name, file in files.items() if name.parts[0] != FOLDER}


def require_the_bits_of_workers(ball_folder: Path, there: Path, here: Path, seeds: int) -> None:
    """Train the tasks again into the folder `here`, and compare the results with those of a cluster."""
    list(run_locally(tasks(ball_folder, here, seeds, SLOW_SCORES), 1))
    for mine, theirs in zip(read_cells(here), read_cells(there), strict=True):
        assert without_time(mine) == without_time(theirs)
        assert theirs.provenance["commit"] == COMMIT
    assert {Path(name).parts[0] for name in files_of(here)} == {"checkpoints", "records"}
    assert files_of(there) == files_of(here), "weights and pictures, byte for byte"
