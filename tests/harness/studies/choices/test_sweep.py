"""The sweep of the learning rate and the search of the families: the same trials for each; cells of it are kept."""

from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import pytest

from baselines.methods.nerf import NERF
from harness.command import settings_commands
from harness.command.main import main
from harness.command.plan_options import planned
from harness.execution.progress import Progress
from harness.plan.profiles import PROFILES, TUNED
from harness.plan.run_plan import Machine, Plan
from harness.plan.schedule import Budget
from harness.studies.choices import arms, families
from harness.studies.choices.arms import Arm, CellArms, CellTask, Ended, Rerendered, kept_cell, views_of
from harness.studies.choices.families import BUDGET, TRIALS, FamilyRow, search, search_plan
from harness.studies.choices.sweep import ARMS, SweepRow, Tried, best_of_each, means, sweep, tried_in
from harness.studies.frontier.frontier_context import FAMILIES, Amount, FrontierContext
from scenes.files.errors import InputError
from tests.harness import tiny
from tests.harness.ball import ball_with_validation_views, write_ball


@pytest.mark.slow
def test_every_method_is_trained_at_every_rate(tmp_path: Path) -> None:
    folder = ball_with_validation_views(tmp_path / "ball")
    plan = planned("smoke", methods=["qnerf"], seeds=1, precision="float32")
    views = replace(tiny.VIEWS, val=2)
    plan = replace(plan, scenes=("ball",), train=tiny.TRAIN, score=tiny.SCORE, views=views, budget=Budget(6, None))
    rows = list(sweep(plan, {"ball": folder}, tmp_path, 1, "cpu"))
    assert [(row.method, row.tried) for row in rows] == [
        (method, tried_in(plan, arm)) for method in plan.methods for arm in ARMS
    ]
    assert len({row.psnr_val for row in rows}) == len(rows) - 2, "only the two arms of all pixels repeat others"
    assert all(row.core_seconds > 0 for row in rows)


def test_the_best_mean_wins_and_a_diverged_run_is_the_worst() -> None:
    slow, fast, other = (
        Tried(name, rate, rate / 10, "linear", (0.9, 0.99), 0.8)  # type: ignore[arg-type]
        for name, rate in (("adam", 0.1), ("adam", 0.2), ("soap", 0.4))
    )
    scores = {slow: (20.0, 20.0), fast: (30.0, None), other: (19.0, 22.0)}
    rows = [
        SweepRow(scene, "nerf", tried, psnr, 1.0)
        for tried, pair in scores.items()
        for scene, psnr in zip(("lego", "ship"), pair, strict=True)
    ]
    assert list(means(rows)) == [other, slow, fast]
    rows.append(SweepRow("lego", "qnerf", fast, 21.0, 1.0))
    assert best_of_each(rows) == {"nerf": other, "qnerf": fast}


def test_the_settings_of_the_short_runs_are_in_the_sweep_and_at_none_of_its_edges() -> None:
    plan = planned("reduced")
    tried = {tried_in(plan, arm) for arm in ARMS}
    for settings in TUNED.values():
        own = settings["optimiser"]
        rates = sorted(arm.learning_rate for arm in tried if (arm.optimiser, arm.betas) == (own.name, own.betas))
        assert rates[0] < settings["learning_rate"] < rates[-1]
    assert {arm.decay for arm in tried} == {"linear", "exponential"}


def test_a_view_set_without_validation_views_is_refused(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball")
    with pytest.raises(InputError, match="has no validation views"):
        views_of(tmp_path / "ball", replace(planned("smoke"), views=tiny.VIEWS), tmp_path, "val")


# the search of the families


def test_every_family_of_the_frontier_has_the_same_trials_first_as_it_is() -> None:
    assert tuple(TRIALS) == FAMILIES
    names = {tuple(trials) for trials in TRIALS.values()}
    assert names == {("as planned", "half the rates", "double the rates", "smaller", "larger")}
    assert all(trials["as planned"].arm == Arm() for trials in TRIALS.values())


@pytest.mark.slow
@pytest.mark.thorough
def test_every_trial_is_another_training(tmp_path: Path) -> None:
    folder = ball_with_validation_views(tmp_path / "ball")
    plan = replace(search_plan(False), methods=("nerf", "hash_grid", "splats"), budget=Budget(4, None))
    plan = replace(plan, views=replace(tiny.VIEWS, val=2), score=tiny.SCORE)
    rows = list(search(plan, {"ball": folder}, tmp_path, 1, "cpu"))
    assert [(row.family, row.trial) for row in rows] == [
        (name, trial) for name in plan.methods for trial in TRIALS[name]
    ]
    assert len({row.psnr_val for row in rows}) == len(rows)


@pytest.mark.parametrize("command", ["sweep", "constants"])
def test_a_search_has_validation_views_though_a_run_needs_none(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def folders(options: object, plan: Plan, show: object) -> NoReturn:
        asked.append(plan.views.val)
        raise InputError("enough")

    monkeypatch.setattr(settings_commands, "_folders", folders)
    assert main(["study", command, "--out", "here.json"]) == 2
    assert [PROFILES["reduced"].views.val, *asked, search_plan(False).views.val] == [0, 5, 5]


def test_it_trains_as_the_frontier_does(tmp_path: Path) -> None:
    """A search under other settings would say nothing about it."""
    paths, machine = (tmp_path, tmp_path, tmp_path), Machine("cpu", 1, 1)
    theirs = FrontierContext(*paths, False, Progress(), machine, True, Amount()).plan(f"core_seconds_{BUDGET:g}")
    ours = search_plan(True)
    assert (ours.train, ours.budget) == (theirs.train, theirs.budget)
    assert replace(ours.views, val=0) == theirs.views


def test_the_best_mean_is_first_and_a_trial_without_a_score_on_some_scene_last() -> None:
    scores = {"as planned": (30.0, 28.0), "smaller": (40.0, None), "larger": (31.0, 29.0)}
    rows = [
        FamilyRow("nerf", trial, scene, psnr, 15.0, 9, "" if psnr else "diverged")
        for trial, pair in scores.items()
        for scene, psnr in zip(("chair", "ship"), pair, strict=True)
    ]
    assert list(families.means(rows, "nerf").items()) == [("larger", 30.0), ("as planned", 29.0), ("smaller", None)]
    assert families.as_json(rows, search_plan(True), {})["means"] == {"nerf": families.means(rows, "nerf")}


# cells are kept when the command is stopped


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
    """Other scenes, seeds and methods of the plan do not matter. Without a folder nothing is kept."""
    smaller = replace(task, plan=replace(task.plan, scenes=("lego",), seeds=(0,), methods=("nerf",)))
    assert kept_cell(task) == kept_cell(task) == kept_cell(smaller) == CellArms("lego", "nerf", 0, ENDED)
    assert trained == [task]
    homeless = replace(task, kept=None)
    assert kept_cell(homeless) == kept_cell(homeless)
    assert trained == [task, homeless, homeless]


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
