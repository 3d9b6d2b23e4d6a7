"""Question 3 of `nox -s speed`: contestants with a made-up clock; what is late is censored and said."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

from baselines.contract import Rays
from harness.execution.progress import Quiet
from harness.records.study import Check
from harness.studies.speed import speed_context as where
from harness.studies.speed import time_to_target as contest
from harness.studies.speed.speed_context import SpeedContext
from harness.studies.speed.time_to_target import (
    PixelSubset,
    Plain,
    PsnrCurve,
    Target,
    even_times,
    examination_of,
    follow,
)
from harness.training.trainer import Diverged
from scenes.view_sets.view_set import ViewSet
from tests.harness.tiny import CPU, TRAIN, rays_and_colours


@pytest.fixture
def here(tmp_path: Path) -> SpeedContext:
    return SpeedContext(CPU, 1, True, 10.0, tmp_path / "view_sets", tmp_path, Quiet())


class Scripted:
    """Each step takes two seconds; what it shows gets better by the step until it is told to fail."""

    def __init__(self, fails_after: float = float("inf"), shows_nan: bool = False) -> None:
        self.seconds = 0.0
        self.fails_after = fails_after
        self.shows_nan = shows_nan

    def step(self) -> None:
        if self.seconds >= self.fails_after:
            raise Diverged(7, "loss")
        self.seconds += 2.0

    def colours(self, rays: Rays) -> Tensor:
        return torch.full((len(rays), 3), float("nan") if self.shows_nan else 1.0 / (1.0 + self.seconds))


def black() -> PixelSubset:
    rays, colours = rays_and_colours(8)
    return PixelSubset(rays, torch.zeros_like(colours))


def test_a_training_is_looked_at_when_its_clock_has_passed() -> None:
    curve = follow(Scripted(), black(), [1.0, 1.5, 5.0, 10.0], lambda curve: False)
    assert curve.before == pytest.approx(0.0)
    assert curve.seconds == [2.0, 6.0, 10.0]  # 1.5 had passed with 1.0 already
    assert curve.psnr == pytest.approx([20 * torch.tensor(one).log10().item() for one in (3.0, 7.0, 11.0)], abs=1e-4)


def test_it_ends_when_enough_is_known() -> None:
    assert follow(Scripted(), black(), even_times(20.0, 10), lambda curve: len(curve.psnr) == 3).seconds == [2, 4, 6]


def test_one_that_diverges_keeps_its_curve_and_says_why() -> None:
    curve = follow(Scripted(fails_after=4.0), black(), even_times(20.0, 10), lambda curve: False)
    assert curve.seconds == [2.0, 4.0]
    assert "step 7" in curve.ended
    assert follow(Scripted(shows_nan=True), black(), [2.0], lambda curve: False).ended != ""


def ratio(here: SpeedContext, curves: list[PsnrCurve], share: float = 1.0, floor: float | None = None) -> Check:
    return contest._ratio(here, "lego", "same", Target(share, 20.0, 60.0), curves, floor)


def test_the_ratio_is_plain_seconds_over_seconds() -> None:
    def curve(seconds: float) -> PsnrCurve:
        return PsnrCurve([seconds, seconds + 1.0], [20.0, 21.0])

    found = ratio(SpeedContext(CPU, 1, True, 1.0, Path(), Path(), Quiet()), [curve(2.0), curve(3.0), curve(6.0)])
    assert (found.id, found.value, found.spread) == ("target.same.lego", 20.0, (10.0, 30.0))
    assert found.limit is not None


def test_one_that_is_late_has_no_ratio_and_says_its_best(here: SpeedContext) -> None:
    good, late = (
        PsnrCurve([1.0, 2.0], [20.0, 21.0]),
        PsnrCurve([1.0, 2.0], [17.0, 19.5], ended="not finite at step 3: loss"),
    )
    found = ratio(here, [good, late], share=0.5)
    assert (found.id, found.value, found.limit) == ("target.same.lego.at50", None, None)
    for said in ("1 of 2", "19.50 dB", "not finite at step 3"):
        assert said in found.why
    assert ratio(here, [PsnrCurve()]).value is None


def test_what_is_shown_without_training_is_no_target(here: SpeedContext) -> None:
    found = ratio(here, [PsnrCurve([1.0, 2.0], [20.0, 21.0], before=20.0)])
    assert found.value is None
    assert "without any training" in found.why
    assert ratio(here, [PsnrCurve([1.0, 2.0], [20.0, 21.0], before=19.9)]).value == 60.0


def test_the_plain_contestant_learns_on_its_own_clock(ball: ViewSet) -> None:
    plain = Plain(TRAIN, ball, where.batches_of(ball, CPU), CPU)
    assert plain.seconds == 0.0
    examination = examination_of(ball, CPU, 200)
    before = examination.psnr(plain.colours(examination.rays))
    after_looking = plain.seconds
    for _ in range(30):
        plain.step()
    assert after_looking == 0.0
    assert plain.seconds > 0.0
    assert examination.psnr(plain.colours(examination.rays)) > before + 1.0
