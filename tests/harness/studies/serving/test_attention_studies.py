"""Curves and φ, against sums by hand and on a tiny field."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from baselines.numerics.attention.regions import Regions
from harness.playback.progressive import Done, coarse
from harness.playback.run_loader import TrainedCell
from harness.studies.serving import anytime
from harness.studies.serving.anytime import (
    MEASURES,
    ORDERS,
    Case,
    Curve,
    Reaching,
    Refined,
    RefinedView,
    cases_of,
    earlier,
    errors_along,
    first_of,
    reaching,
    refine_in,
)
from harness.studies.serving.attention_views import KINDS, AttendedView, RegionView, attention_of, region_view
from harness.studies.serving.serving_context import ServingContext, plain
from harness.training.scoring.evaluate import View
from tests.harness.playback.test_progressive import Watched
from tests.harness.studies.serving.conftest import Ticks

pytestmark = pytest.mark.slow


def flat(value: float, height: int = 2, width: int = 2) -> View:
    shape = (height, width)
    return View(np.full((*shape, 3), value, np.float32), np.ones(shape, np.float32), np.ones(shape, np.float32))


def done(pixels: list[int], value: float, share: float) -> Done:
    ones = np.full(len(pixels), value, np.float32)
    return Done(np.array(pixels), np.repeat(ones[:, None], 3, axis=1), ones, ones, share, 1)


PARTS = [done([0, 1], 0.5, 0.5), done([2, 3], 0.5, 1.0)]
BY_HAND = Refined(flat(0.0), PARTS, np.array([[1.0, 2.0, 4.0]]))


def test_errors_fall_part_by_part() -> None:
    errors = list(errors_along(BY_HAND, flat(0.5), np.array([True, False, False, False])))
    assert errors == [[0.5, 0.5], [pytest.approx(0.5 * np.sqrt(0.5)), 0.0], [0.0, 0.0]]


def curve_of(errors: list[float], *repeats: float) -> Curve:
    """A curve whose repeats are slower by these factors."""
    seconds = np.array([[slow * 0.5 * (place + 1) for place in range(len(errors))] for slow in repeats or (1.0,)])
    return Curve(seconds, dict.fromkeys(MEASURES, errors))


@pytest.mark.parametrize(
    ("errors", "seconds"),
    [
        ([1.0, 0.6, 0.4, 0.0], 1.5),
        ([1.0, 0.4, 0.6, 0.0], 2.0),  # it rises again
        ([1.0, 0.9, 0.8, 0.7], None),
        ([0.0, 0.0], 0.5),
    ],
)
def test_reaching_is_when_the_error_stays_below(errors: list[float], seconds: float | None) -> None:
    reached = reaching(curve_of(errors, 1.0, 3.0, 0.5), "attended", 0.5)
    assert reached == (None if seconds is None else Reaching(seconds, 0.5 * seconds, 3.0 * seconds))


def test_all_orders_are_measured_by_the_coarse_frame_s_error_even_without_such_a_frame() -> None:
    case = Case("ball", "point", {"raster": curve_of([1.0, 0.15, 0.05]), "plain": curve_of([3.0, 0.25, 0.15])})
    assert case.times("attended") == {"raster": Reaching(1.5, 1.5, 1.5), "plain": None}


def test_the_first_is_before_all_others_in_every_repeat() -> None:
    times = {"attention": Reaching(1.0, 0.9, 1.1), "raster": Reaching(2.0, 1.2, 3.0), "plain": None}
    assert first_of(times) == "attention"
    assert not earlier(times, "raster", "attention")
    assert earlier(times, "raster", "plain")
    overlapping = {**times, "raster": Reaching(2.0, 1.1, 3.0)}
    assert first_of(overlapping) is None


def cases(kinds: dict[str, list[float]]) -> list[Case]:
    """Cases on up to three scenes, in which attention takes these multiples of raster order's time."""
    return [
        Case(scene, kind, {"attention": curve_of([1.0, 0.0], factor), "raster": curve_of([1.0, 0.0], 1.0, 2.0)})
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
    check = anytime._earlier_check(cases(kinds), "attended")
    assert (check.status, check.value, check.owner) == (status, ahead, "paper")
    assert anytime._earlier_check(cases(kinds), "whole").status == "measured"


@pytest.fixture
def view(context: ServingContext, cell: TrainedCell) -> RegionView:
    return region_view(context, cell, context.orbit(cell.scene, 1)[0])


@pytest.mark.parametrize("order", ["attention", "raster", "spread"])
def test_every_order_ends_in_the_plain_picture(view: RegionView, ticks: Ticks, order: Any) -> None:
    run = refine_in(view, order, "foveal" if order == "attention" else None, ticks)
    assert np.diff(run.seconds).tolist() == [[1.0] * len(run.parts)], "one reading of the clock per part"
    assert len(run.parts) == view.regions.count
    *_, last = errors_along(run, plain(view.cell.learner, view.camera, view.cell.chunk), np.arange(1))
    assert max(last) < 1e-5


def test_seconds_are_medians_over_repeats_and_means_over_views(
    view: RegionView, monkeypatch: pytest.MonkeyPatch
) -> None:
    clocks = iter([1.0, 5.0, 3.0])

    def with_clock(view: RegionView, order: Any, kind: str | None, clock: Any) -> Refined:
        scale = next(clocks)
        return Refined(flat(0.0), PARTS, scale * np.array([[1.0, 2.0, 3.0]]))

    monkeypatch.setattr(anytime, "refine_in", with_clock)
    measured = anytime.measure(view, [("raster", None)], 3)
    assert measured["raster", None].seconds.tolist() == [[1.0, 2.0, 3.0], [5.0, 10.0, 15.0], [3.0, 6.0, 9.0]]

    small = replace(view, regions=Regions(2, 2, 1))
    maps = {kind: np.ones(4) for kind in KINDS} | {"point": np.array([1.0, 0.0, 0.0, 0.0])}
    first, second = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 9.0]]), np.array([[3.0, 4.0, 5.0], [3.0, 8.0, 9.0]])

    def seen(value: float, seconds: np.ndarray) -> RefinedView:
        runs: Any = {(order, None): Refined(flat(0.0), PARTS, seconds) for order in ("raster", "spread", "plain")}
        runs["attention", "point"] = runs["raster", None]
        return RefinedView(AttendedView(small, 0, flat(0.0), maps), flat(value), runs)

    (case,) = cases_of([seen(0.5, first), seen(0.25, second)])
    assert (case.scene, case.kind, list(case.curves)) == ("ball", "point", list(ORDERS))
    curve = case.curves["raster"]
    assert curve.seconds.tolist() == [[2.0, 3.0, 4.0], [2.0, 5.0, 9.0]], "means over views, repeat by repeat"
    assert curve.errors["attended"] == [0.375, 0.125, 0.125], "of the attended pixel, 0: done with the first part"


def test_a_map_costs_what_it_renders(view: RegionView) -> None:
    learner, chunk = view.cell.learner, view.cell.chunk
    frame, rough = (coarse(learner, view.camera, view.stride, chunk, bins) for bins in (view.bins, view.bins // 2))
    costs = {}
    for kind in KINDS:
        watched: Any = Watched(learner)
        attention_of(kind, replace(view, cell=replace(view.cell, learner=watched)), frame.view)
        costs[kind] = sum(watched.evaluations)
    assert rough.network_evaluations > 0
    assert costs == {"point": 0, "mask": 0, "foveal": 0, "gradients": 0, "error": rough.network_evaluations}
