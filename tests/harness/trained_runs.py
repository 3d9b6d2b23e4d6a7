"""Finished runs on the ball, so small that a cell trains in a moment, made in this process by the run's own code."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from harness.command.plan_options import planned
from harness.execution.group import run_group
from harness.execution.group_loop import Event
from harness.execution.progress import Progress
from harness.execution.run import run
from harness.plan.group_task import GroupTask
from harness.plan.run_plan import Machine
from harness.plan.settings import TrainSettings
from harness.records.cells import CellRecord
from harness.run_folder.output_folder import claim
from harness.training import cell_training
from harness.training.learner import Learner
from tests.harness.ball import write_ball
from tests.harness.patching import preceded
from tests.harness.tiny import SCORE, TRAIN

SIZE = 16


def in_this_process(tasks: list[GroupTask], _: int) -> Iterator[Event]:
    """Replace `harness.execution.run.run_locally`, whose workers take seconds to start and see no patches."""
    for task in tasks:
        cells: list[CellRecord] = []
        run_group(task, lambda share: None, cells.append)
        yield from (Event(task, cell=cell) for cell in cells)


def train_run(
    folder: Path,
    methods: list[str],
    train: TrainSettings = TRAIN,
    steps: int = 24,
    no_need: list[str] | None = None,
    on_trained: Callable[[Learner], None] = lambda learner: None,
    others: Sequence[Path] = (),
    size: int = SIZE,
) -> Path:
    """Train a run; returns its output folder `run`, next to which its view set `ball` lies. `others` are further view
    sets. `on_trained` gets each learner at its end.
    """
    views, out = folder / "ball", folder / "run"
    if not views.exists():
        write_ball(views, size=size, train=5, test=3)
    given = [views, *others]
    plan = planned(
        "smoke", view_set=given, methods=methods, seeds=1, budget_steps=steps, resolution=size, no_need=no_need
    )
    plan = replace(plan, train=train, score=replace(SCORE, checkpoints=1, chunk=100, train_views=1))
    machine = Machine("cpu", 1, 1)
    claim(out, plan, machine, resume=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.execution.run.run_locally", in_this_process)
        preceded(patch, cell_training, "save_checkpoint", lambda learner, path: on_trained(learner))
        run(plan, out, folder, machine, "none", Progress())
    return out
