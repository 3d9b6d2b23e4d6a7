"""Errors over time, against sums by hand and on a tiny field."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from baselines.contract import Rendering
from baselines.numerics.attention.maps import MAPS
from harness.playback.progressive import Done, coarse
from harness.playback.run_loader import TrainedCell
from harness.studies.serving import attention
from harness.studies.serving.attention import (
    MEASURES,
    ORDERS,
    STRIDE,
    Case,
    Refined,
    RegionView,
    Times,
    attention_of,
    earlier,
    errors_along,
    findings_of,
    refine_in,
    refined,
    region_view,
    times_of,
)
from harness.studies.serving.serving_context import Clock, ServingContext, plain
from harness.training.scoring.evaluate import View
from tests.harness.patching import changed

pytestmark = pytest.mark.slow


def flat(value: float) -> View:
    shape = (2, 2)
    return View(np.full((*shape, 3), value, np.float32), np.ones(shape, np.float32), np.ones(shape, np.float32))


def done(pixels: list[int], value: float, share: float) -> Done:
    ones = np.full(len(pixels), value, np.float32)
    return Done(np.array(pixels), np.repeat(ones[:, None], 3, axis=1), ones, ones, share, 1)


FIRST_PIXEL = np.array([True, False, False, False])
SECONDS = np.array([[1.0, 2.0, 4.0], [3.0, 5.0, 9.0]])
BY_HAND = Refined(flat(0.0), [done([0, 1], 0.5, 0.5), done([2, 3], 0.5, 1.0)], SECONDS)


def test_errors_fall_part_by_part() -> None:
    errors = [tuple(error.values()) for error in errors_along(BY_HAND, flat(0.5), FIRST_PIXEL)]
    assert errors == [(0.5, 0.5), (pytest.approx(0.5 * np.sqrt(0.5)), 0.0), (0.0, 0.0)]


def test_a_time_is_when_the_error_stays_below_a_tenth_of_the_coarse_frame_s() -> None:
    worse = done([0], 0.0, 1.0)  # the first pixel is wrong again, until the last part
    again = replace(
        BY_HAND, parts=[BY_HAND.parts[0], worse, done([0, 2, 3], 0.5, 1.0)], seconds=np.ones((1, 4)).cumsum(1)
    )
    never = replace(BY_HAND, parts=[BY_HAND.parts[0], worse])
    # the other orders are measured by the coarse frame of raster order, even if they begin with another frame
    white = replace(BY_HAND, first=flat(5.0), parts=[done([0, 1, 2, 3], 0.5, 1.0)], seconds=np.array([[0.0, 7.0]]))
    times = times_of({"raster": BY_HAND, "attention": again, "plain": white}, flat(0.5), FIRST_PIXEL)
    assert {order: seconds.tolist() for order, seconds in times["attended"].items()} == {
        "raster": [2.0, 5.0], "attention": [4.0], "plain": [7.0],
    }  # fmt: skip
    assert times["whole"]["raster"].tolist() == [4.0, 9.0]
    assert np.isinf(times_of({"raster": never}, flat(0.5), FIRST_PIXEL)["attended"]["raster"]).all()


def test_an_order_is_earlier_in_every_repeat_or_not_at_all() -> None:
    times = {"attention": np.array([0.9, 1.1]), "raster": np.array([1.2, 3.0]), "plain": np.array([np.inf, np.inf])}
    assert earlier(times, "attention", "raster")
    assert earlier(times, "raster", "plain")
    assert not earlier(times, "raster", "attention")
    assert not earlier({**times, "raster": np.array([1.1, 3.0])}, "attention", "raster")
    assert not earlier({**times, "raster": times["plain"]}, "raster", "plain")


def cases(kinds: dict[str, list[float]]) -> list[Case]:
    """Cases on up to three scenes, in which attention takes these multiples of raster order's time."""

    def times(factor: float) -> Times:
        raster = np.array([1.0, 2.0])
        return {"attention": np.array([factor]), "raster": raster, "plain": np.array([np.inf])}

    return [
        Case(scene, kind, dict.fromkeys(MEASURES, times(factor)))
        for kind, factors in kinds.items()
        for scene, factor in zip(("ball", "lego", "chair"), factors, strict=False)
    ]


@pytest.mark.parametrize(
    ("kinds", "status", "ahead"),
    [
        ({"point": [0.5, 0.5, 0.5], "mask": [0.5, 0.9, 0.5]}, "pass", 6),
        ({"point": [0.5, 0.5, 0.5], "mask": [0.5, 3.0, 0.5]}, "inconclusive", 5),
        ({"point": [3.0, 3.0, 3.0]}, "fail", 0),
        ({"point": [3.0, 1.5, 3.0]}, "inconclusive", 0),  # undecided on one scene
        ({"point": [0.5, 0.5]}, "inconclusive", 2),  # too few scenes
    ],
)
def test_the_claim_holds_on_every_scene_or_fails_on_every_one(
    kinds: dict[str, list[float]], status: str, ahead: int
) -> None:
    checks = {check.id: check for check in findings_of(cases(kinds)) if isinstance(check, attention.Check)}
    claim = checks["earlier.attended"]
    assert (claim.status, claim.value, claim.owner) == (status, ahead, "paper")
    assert checks["earlier.whole"].status == "measured"
    assert "whole.plain" not in checks, "it is never reached"
    factors = [factor for some in kinds.values() for factor in some]
    assert checks["sooner.attended"].spread == (pytest.approx(1.5 / max(factors)), pytest.approx(1.5 / min(factors)))


@pytest.fixture
def view(context: ServingContext, cell: TrainedCell) -> RegionView:
    return region_view(context, cell, context.orbit(cell.scene, 1)[0])


@pytest.mark.parametrize("name", ["foveal", "raster"])
def test_every_order_ends_in_the_plain_picture(view: RegionView, ticks: Clock, name: str) -> None:
    run = refine_in(view, name, ticks)
    assert np.diff(run.seconds).tolist() == [[1.0] * len(run.parts)], "one reading of the clock per part"
    assert len(run.parts) == view.regions.count
    *_, last = errors_along(run, plain(view.cell.learner, view.camera, view.cell.chunk), np.arange(1))
    assert max(last.values()) < 1e-5


def test_repeats_are_kept_apart(view: RegionView, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def with_clock(view: RegionView, name: str, clock: Any) -> Refined:
        asked.append(name)
        return replace(BY_HAND, seconds=len(asked) * SECONDS[:1])

    monkeypatch.setattr(attention, "refine_in", with_clock)
    measured = refined(view, ["point"], 2)
    assert asked == ["point", "raster", "plain", "plain", "raster", "point"], "in alternating order"
    assert measured["raster"].seconds.tolist() == [[2.0, 4.0, 8.0], [5.0, 10.0, 20.0]]
    assert set(measured) == {"point", *ORDERS} - {"attention"}


def test_a_map_costs_what_it_renders(view: RegionView, monkeypatch: pytest.MonkeyPatch) -> None:
    learner, chunk = view.cell.learner, view.cell.chunk
    frame, rough = (coarse(learner, view.camera, STRIDE, chunk, bins) for bins in (view.bins, view.bins // 2))
    costs, evaluations = {}, list[int]()

    def counted(rendering: Rendering, *_: object) -> Rendering:
        evaluations.append(rendering.network_evaluations)
        return rendering

    changed(monkeypatch, learner, "render", counted)
    for kind in MAPS:
        evaluations.clear()
        attention_of(kind, view, frame.view)
        costs[kind] = sum(evaluations)
    assert rough.network_evaluations > 0
    assert costs == {"point": 0, "mask": 0, "foveal": 0, "gradients": 0, "error": rough.network_evaluations}
