"""Cells of a comparison of settings are kept when the command is stopped."""

from dataclasses import replace
from pathlib import Path

import pytest

from baselines.methods.nerf import NERF
from harness.plan.profiles import PROFILES
from harness.studies.choices import arms
from harness.studies.choices.arms import Arm, CellArms, CellTask, Ended, Rerendered, kept_cell

NERF_OF_ANOTHER_START = replace(NERF, start=7.0)
ENDED = {"as planned": Ended(30.5, 2.0, {"behind_opaque": Rerendered(1.0, 0.5, 1e-5)}, 1.9, 0.7), "less": Ended(None)}


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> list[CellTask]:
    """The tasks that were trained."""
    tasks: list[CellTask] = []

    def train(task: CellTask) -> CellArms:
        tasks.append(task)
        return CellArms(task.scene, task.method, task.seed, ENDED)

    monkeypatch.setattr(arms, "trained_cell", train)
    return tasks


@pytest.fixture
def task(tmp_path: Path) -> CellTask:
    plan = PROFILES["reduced"]
    return CellTask(
        "lego", "nerf", 0, tmp_path / "lego-1", tmp_path, plan, {"less": Arm({"bins": 8})}, kept=tmp_path / "k"
    )


def test_a_kept_cell_is_the_same_and_not_trained_again(task: CellTask, trained: list[CellTask]) -> None:
    """Other scenes, seeds and methods of the plan do not matter."""
    smaller = replace(task, plan=replace(task.plan, scenes=("lego",), seeds=(0,), methods=("nerf",)))
    assert kept_cell(task) == kept_cell(task) == kept_cell(smaller) == CellArms("lego", "nerf", 0, ENDED)
    assert trained == [task]


def test_a_cell_of_anything_else_is_not_used(task: CellTask, trained: list[CellTask]) -> None:
    kept_cell(task)
    others = [
        replace(task, seed=1),
        replace(task, method="qnerf"),
        replace(task, arms={"less": Arm({"bins": 4})}),
        replace(task, view_set=task.view_set.with_name("lego-2")),
        replace(task, scored_on="val"),
        replace(task, plan=replace(task.plan, train=replace(task.plan.train, rays=7))),
        replace(task, plan=replace(task.plan, train=replace(task.plan.train, own={"nerf": NERF_OF_ANOTHER_START}))),
    ]
    for other in others:
        kept_cell(other)
    assert trained == [task, *others]


def test_a_damaged_cell_is_trained_again(task: CellTask, trained: list[CellTask]) -> None:
    kept_cell(task)
    for file in (task.scratch / "k").iterdir():
        file.write_text(file.read_text().replace("30.5", "31.5"))
    assert kept_cell(task).ended == ENDED
    assert len(trained) == 2


def test_without_a_folder_nothing_is_kept(task: CellTask, trained: list[CellTask]) -> None:
    for _ in range(2):
        kept_cell(replace(task, kept=None))
    assert len(trained) == 2
