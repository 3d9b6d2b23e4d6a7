"""A run that a page can show: two methods, trained for a moment on the ball, in this process."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.__main__ import main
from harness.group import GroupTask, run_group
from harness.local_executor import Event
from harness.records import CellRecord
from tests.harness.ball import write_ball

SIZE = 40
"""Pixels: nine regions."""


def train(folder: Path) -> Path:
    """The output folder `run`; its view set `ball` is beside it. Without a process of its own for the training."""

    def here(tasks: list[GroupTask], workers: int) -> Iterator[Event]:
        for task in tasks:
            cells: list[CellRecord] = []
            run_group(task, lambda share: None, cells.append)
            yield from (Event(task, cell=cell) for cell in cells)

    views, out = write_ball(folder / "ball", size=SIZE, train=4, test=3), folder / "run"
    options = f"--profile smoke --view-set {views} --out {out} --resolution {SIZE} --methods nerf qnerf --seeds 1"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.runner.run_locally", here)
        code = main(["run", *options.split(), "--budget-steps", "40", "--workers", "1", "--quiet", "--no-serving"])
    assert code == 0
    return out
