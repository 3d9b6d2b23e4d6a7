"""The search of the families: the same number of trials for each, and each trial is another training."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.execution.progress import Quiet
from harness.plan.run_plan import Machine
from harness.plan.schedule import Budget
from harness.studies.choices.arms import Arm
from harness.studies.choices.families import BUDGET, TRIALS, FamilyRow, as_json, means, search, search_plan
from harness.studies.frontier.frontier_context import FAMILIES, Amount, FrontierContext
from tests.harness import tiny
from tests.harness.ball import ball_with_validation_views


def test_every_family_of_the_frontier_has_the_same_trials_first_as_it_is() -> None:
    assert tuple(TRIALS) == FAMILIES
    names = {tuple(trials) for trials in TRIALS.values()}
    assert names == {("as planned", "half the rates", "double the rates", "smaller", "larger")}
    assert all(trials["as planned"].arm == Arm() for trials in TRIALS.values())


@pytest.mark.slow
def test_every_trial_is_another_training(tmp_path: Path) -> None:
    folder = ball_with_validation_views(tmp_path / "ball")
    plan = replace(search_plan(False), methods=("nerf", "hash_grid", "splats"), budget=Budget(4, None))
    plan = replace(plan, views=replace(tiny.VIEWS, val=2), score=tiny.SCORE)
    rows = list(search(plan, {"ball": folder}, tmp_path, 1, "cpu"))
    assert [(row.family, row.trial) for row in rows] == [
        (name, trial) for name in plan.methods for trial in TRIALS[name]
    ]
    assert len({row.psnr_val for row in rows}) == len(rows)


def test_it_trains_as_the_frontier_does(tmp_path: Path) -> None:
    """A search under other settings would say nothing about it."""
    paths, machine = (tmp_path, tmp_path, tmp_path), Machine("cpu", 1, 1)
    theirs = FrontierContext(*paths, False, Quiet(), machine, True, Amount()).plan(f"core_seconds_{BUDGET:g}")
    ours = search_plan(True)
    assert (ours.train, ours.budget, ours.views) == (theirs.train, theirs.budget, theirs.views)


def test_the_best_mean_is_first_and_a_trial_without_a_score_on_some_scene_last() -> None:
    scores = {"as planned": (30.0, 28.0), "smaller": (40.0, None), "larger": (31.0, 29.0)}
    rows = [
        FamilyRow("nerf", trial, scene, psnr, 15.0, 9, "" if psnr else "diverged")
        for trial, pair in scores.items()
        for scene, psnr in zip(("chair", "ship"), pair, strict=True)
    ]
    assert list(means(rows, "nerf").items()) == [("larger", 30.0), ("as planned", 29.0), ("smaller", None)]
    assert as_json(rows, search_plan(True), {})["means"] == {"nerf": means(rows, "nerf")}
