"""The sweep of the learning rate: every method at every rate, on validation views."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.plan.profiles import planned
from harness.plan.schedule import Budget
from harness.studies.choices.arms import views_of
from harness.studies.choices.sweep import FACTORS, SweepRow, best_rates, sweep
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
    assert [(row.method, row.learning_rate) for row in rows] == [
        (method, tiny.TRAIN.learning_rate * factor) for method in plan.methods for factor in FACTORS
    ]
    assert len({row.psnr_val for row in rows}) == len(rows), "each rate is another training"


def test_the_best_mean_wins_and_a_diverged_run_is_the_worst() -> None:
    scores = {0.1: (20.0, 20.0), 0.2: (30.0, None), 0.4: (19.0, 22.0)}
    rows = [
        SweepRow(scene, "nerf", rate, psnr)
        for rate, pair in scores.items()
        for scene, psnr in zip(("lego", "ship"), pair, strict=True)
    ]
    assert best_rates(rows) == {"nerf": 0.4}


def test_a_view_set_without_validation_views_is_refused(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball")
    with pytest.raises(InputError, match="has no validation views"):
        views_of(tmp_path / "ball", replace(planned("smoke"), views=tiny.VIEWS), tmp_path, "val")
