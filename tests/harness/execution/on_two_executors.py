"""Tiny groups of cells, and the files of their results that are the same on every executor."""

from pathlib import Path
from typing import Any

from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.plan.settings import ScoreSettings
from tests.harness.tiny import TRAIN, VIEWS
from tests.replacing import replace

SLOW_SCORES = ScoreSettings(checkpoints=2, earliest=0.5, chunk=24, train_views=10, stored_views=1)
"""Scoring takes a second, long enough to kill a node between two cells of a group."""


def tasks(ball_folder: Path, out: Path, seeds: int, score: ScoreSettings, **changes: Any) -> list[GroupTask]:
    task = GroupTask("ball", 0, ("nerf", "qnerf"), TRAIN, score, Budget(24, None), out, ball_folder, VIEWS)
    return [replace(task, seed=seed, **changes) for seed in range(seeds)]


def files_of(out: Path) -> dict[str, bytes]:
    """Return the files without clocks."""
    return {
        file.relative_to(out).as_posix(): file.read_bytes()
        for file in out.rglob("*")
        if file.is_file() and file.suffix != ".json"
    }
