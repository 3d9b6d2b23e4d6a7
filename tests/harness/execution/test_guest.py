"""A guest is trained for the core seconds of `nerf` on each scene, after the others, once."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.command.plan_options import planned
from harness.execution.progress import Quiet
from harness.execution.run import run
from harness.plan.run_plan import Machine, Plan
from harness.plan.schedule import Budget
from harness.records.cells import cell_path, read_cell, read_comparisons, read_run
from tests.harness.tiny import SCORE, TRAIN, VIEWS

pytestmark = pytest.mark.slow


def plan_of(ball_folder: Path) -> Plan:
    plan = planned("smoke", view_set=[ball_folder], methods=["nerf"], seeds=2)
    return replace(plan, budget=Budget(20, None), train=TRAIN, score=SCORE, views=VIEWS, guest="nerf_matched")


def test_a_guest(ball_folder: Path, tmp_path: Path) -> None:
    plan, machine = plan_of(ball_folder), Machine("cpu", 1, 1)
    assert run(plan, tmp_path, tmp_path / "sets", machine, "command", Quiet()) == 0
    ours, theirs = (read_cell(cell_path(tmp_path, "ball", name, 0)) for name in ("nerf", "nerf_matched"))
    assert theirs.status == "done"
    assert theirs.settings["budget"]["core_seconds"] == ours.train_core_seconds
    assert not cell_path(tmp_path, "ball", "nerf_matched", 1).exists()
    assert read_run(tmp_path).guests == ["nerf_matched"]
    assert read_run(tmp_path).main_methods == ["nerf"]
    assert read_comparisons(tmp_path) == []
    before = cell_path(tmp_path, "ball", "nerf_matched", 0).read_bytes()
    assert run(plan, tmp_path, tmp_path / "sets", machine, "command", Quiet()) == 0
    assert cell_path(tmp_path, "ball", "nerf_matched", 0).read_bytes() == before
