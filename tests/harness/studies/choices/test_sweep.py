"""The sweep of the learning rate: every method at every rate, on validation views."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.command.plan_options import planned
from harness.plan.profiles import TUNED
from harness.plan.schedule import Budget
from harness.studies.choices.arms import views_of
from harness.studies.choices.sweep import ARMS, SweepRow, Tried, best_of_each, means, sweep, tried_in
from scenes.files.errors import InputError
from tests.harness import tiny
from tests.harness.ball import ball_with_validation_views, write_ball


@pytest.mark.slow
def test_every_method_is_trained_at_every_rate(tmp_path: Path) -> None:
    folder = ball_with_validation_views(tmp_path / "ball")
    plan = planned("smoke", methods=["nerf", "qnerf"], seeds=1, precision="float32")
    views = replace(tiny.VIEWS, val=2)
    plan = replace(plan, scenes=("ball",), train=tiny.TRAIN, score=tiny.SCORE, views=views, budget=Budget(6, None))
    rows = list(sweep(plan, {"ball": folder}, tmp_path, 1, "cpu"))
    assert [(row.method, row.tried) for row in rows] == [
        (method, tried_in(plan, arm)) for method in plan.methods for arm in ARMS
    ]
    assert len({row.psnr_val for row in rows}) == len(rows) - 4, "only the two arms of all pixels repeat others"
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
