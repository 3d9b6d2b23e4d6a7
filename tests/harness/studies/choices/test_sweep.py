"""The sweep of the learning rate: every method at every rate, on validation views."""

from dataclasses import replace
from pathlib import Path

import pytest

from harness.plan.profiles import TUNED, planned
from harness.plan.schedule import Budget
from harness.studies.choices.arms import views_of
from harness.studies.choices.sweep import ARMS, SweepRow, best_rates, means, sweep
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
    assert [(row.method, row.optimiser, row.learning_rate, row.covered_share) for row in rows] == [
        (method, name, TUNED[name]["learning_rate"] * factor, tiny.TRAIN.covered_share if share is None else share)
        for method in plan.methods
        for name, factor, share in ARMS
    ]
    assert len({row.psnr_val for row in rows}) == len(rows) - 4, "each arm but the two of all pixels is another one"
    assert all(row.core_seconds > 0 for row in rows)


def test_the_best_mean_wins_and_a_diverged_run_is_the_worst() -> None:
    scores = {("adam", 0.1): (20.0, 20.0), ("adam", 0.2): (30.0, None), ("soap", 0.4): (19.0, 22.0)}
    rows = [
        SweepRow(scene, "nerf", name, rate, 0.8, psnr, 1.0)  # type: ignore[arg-type]
        for (name, rate), pair in scores.items()
        for scene, psnr in zip(("lego", "ship"), pair, strict=True)
    ]
    assert list(means(rows, 0.8)) == [("soap", 0.4), ("adam", 0.1), ("adam", 0.2)]
    assert best_rates(rows) == {"nerf": {"adam": 0.1, "soap": 0.4}}
    rows.append(SweepRow("lego", "nerf", "adam", 0.2, 0.0, 99.0, 1.0))
    assert best_rates(rows) == {"nerf": {"adam": 0.1, "soap": 0.4}}, "rays through all pixels are another question"


def test_a_view_set_without_validation_views_is_refused(tmp_path: Path) -> None:
    write_ball(tmp_path / "ball")
    with pytest.raises(InputError, match="has no validation views"):
        views_of(tmp_path / "ball", replace(planned("smoke"), views=tiny.VIEWS), tmp_path, "val")
