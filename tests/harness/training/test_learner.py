"""What the harness asks of a method, and what becomes of one that this machine cannot train."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.records.cells import cell_path, read_cell, write_cell
from harness.training import lockstep
from harness.training.learner import Job
from harness.training.lockstep import train_group
from harness.training.make_learner import NotAvailable, learner_for
from scenes.view_sets.view_set import ViewSet
from tests.harness.tiny import SCORE, TRAIN


def test_a_method_that_cannot_run_here_costs_nobody_else_anything(
    ball: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing_one(job: Job) -> Any:
        if job.method == "nerf_matched":
            raise NotAvailable("needs a library that is not here")
        return learner_for(job)

    monkeypatch.setattr(lockstep, "learner_for", missing_one)
    score = replace(SCORE, checkpoints=1)
    task = GroupTask("ball", 0, ("nerf", "nerf_matched"), TRAIN, score, Budget(2, None), tmp_path)
    shares: list[float] = []
    cells = {one.method: one for one in train_group(task, ball, {}, shares.append)}
    assert (cells["nerf"].status, cells["nerf"].steps) == ("done", 2)
    assert shares[-1] == 1.0
    lacking = cells["nerf_matched"]
    assert (lacking.status, lacking.reason) == ("not_available", "needs a library that is not here")
    assert (lacking.steps, lacking.scores, lacking.curve) == (0, {}, [])
    write_cell(tmp_path, lacking)
    assert read_cell(cell_path(tmp_path, "ball", "nerf_matched", 0)) == lacking
