"""Curves, allocations and φ, against sums by hand and on a tiny field."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from baselines.numerics.attention.priorities import PHI
from baselines.numerics.attention.regions import Regions
from harness.playback.progressive import Done, coarse
from harness.playback.run_loader import TrainedCell
from harness.records.serving_record import Anytime
from harness.studies.serving import allocations, anytime
from harness.studies.serving.anytime import (
    KINDS,
    ORDERS,
    Looked,
    Measured,
    Refined,
    Seen,
    TimedCurve,
    attended_pixels,
    attention_of,
    errors_along,
    hardest_pixels,
    reaching,
    reachings,
    refined,
)
from harness.studies.serving.attention_study import STRIDE, measured_attention, tile_of
from harness.studies.serving.serving_context import ServingContext, plain
from harness.training.evaluate import View
from tests.harness.studies.serving.conftest import Ticks
from tests.harness.trained_runs import SIZE

pytestmark = pytest.mark.slow


def flat(value: float, height: int = 2, width: int = 2) -> View:
    shape = (height, width)
    return View(np.full((*shape, 3), value, np.float32), np.ones(shape, np.float32), np.ones(shape, np.float32))


def done(pixels: list[int], value: float, share: float) -> Done:
    ones = np.full(len(pixels), value, np.float32)
    return Done(None, np.array(pixels), np.repeat(ones[:, None], 3, axis=1), ones, ones, share, 1)


BY_HAND = Refined(flat(0.0), [1.0, 2.0, 4.0], [done([0, 1], 0.5, 0.5), done([2, 3], 0.5, 1.0)])


def test_errors_fall_part_by_part() -> None:
    hardest, attended = np.array([[True, False, False, False], [False, False, True, False]])
    found = list(errors_along(BY_HAND, flat(0.5), hardest, attended))
    assert found == [[0.5, 0.5, 0.5], [pytest.approx(0.5 * np.sqrt(0.5)), 0.0, 0.5], [0.0, 0.0, 0.0]]


def test_an_error_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        list(errors_along(BY_HAND, flat(float("nan"))))


def curve_of(errors: list[float], *repeats: float) -> TimedCurve:
    """Repeats that are as many times as slow."""
    seconds = np.array([[slow * 0.5 * (place + 1) for place in range(len(errors))] for slow in repeats or (1.0,)])
    middle = np.median(seconds, axis=0).tolist()
    none, total = [9.0] * len(errors), (middle[-1], middle[-1])
    return TimedCurve(Anytime("ball", "nerf", "point", "raster", 1, middle, none, total, none, errors, none), seconds)


@pytest.mark.parametrize(
    ("errors", "seconds"),
    [
        ([1.0, 0.6, 0.4, 0.0], 1.5),
        ([1.0, 0.4, 0.6, 0.0], 2.0),  # it rises again: only then it stays
        ([1.0, 0.9, 0.8, 0.7], None),
        ([0.0, 0.0], 0.5),
    ],
)
def test_reaching_is_when_the_error_stays_below(errors: list[float], seconds: float | None) -> None:
    found = reaching(curve_of(errors, 1.0, 3.0, 0.5), "hardest", 1.0, 0.5)
    assert (found.measure, found.error, found.seconds) == ("hardest", 0.5, seconds)
    assert found.spread == (None if seconds is None else (0.5 * seconds, 3.0 * seconds))


def test_all_orders_are_measured_by_the_coarse_frame_s_error_also_one_that_has_none() -> None:
    coarse = curve_of([1.0, 0.15, 0.05])
    white = curve_of([3.0, 0.25, 0.15])
    white = replace(white, anytime=replace(white.anytime, order="plain"))
    found = {(one.order, one.measure): one.seconds for one in reachings([white, coarse])}
    assert (found["raster", "hardest"], found["plain", "hardest"]) == (1.5, None)


def test_the_hardest_quarter_is_where_the_coarse_frame_is_most_wrong() -> None:
    finished = flat(0.5, 4, 4)
    first = flat(0.5, 4, 4)
    first.colour[2:, :2] = 0.1
    first.colour[:2, 2:] = 0.4
    found = hardest_pixels(Regions(4, 4, 2), first, finished).reshape(4, 4)
    assert found[2:, :2].all()
    assert found.sum() == 4


@pytest.fixture
def view(situation: ServingContext, cell: TrainedCell) -> Looked:
    camera = situation.camera(cell, situation.orbit(cell.scene, 1)[0])
    return Looked(cell, camera, Regions(SIZE, SIZE, tile_of(SIZE)), STRIDE, 16)


@pytest.mark.parametrize("order", ["attention", "raster", "spread"])
def test_every_order_ends_in_the_plain_picture(view: Looked, ticks: Ticks, order: Any) -> None:
    found = refined(view, order, "foveal" if order == "attention" else None, ticks)
    assert np.diff(found.seconds).tolist() == [1.0] * len(found.parts), "one look at the clock a part"
    assert len(found.parts) == view.regions.count
    wanted = plain(view.cell.learner, view.camera, view.cell.chunk)
    np.testing.assert_allclose(found.at(len(found.parts)).colour, wanted.colour, atol=1e-5)
    *_, last = errors_along(found, wanted)
    assert max(last) < 1e-5


def test_by_attention_the_attended_quarter_is_done_first(view: Looked) -> None:
    found = refined(view, "attention", "point")
    first = plain(view.cell.learner, view.camera, view.cell.chunk)
    attended = attended_pixels(view.regions, attention_of("point", view, first)[0])
    early = np.concatenate([part.pixels for part in found.parts[: view.regions.count // 4]])
    assert set(early.tolist()) == set(np.flatnonzero(attended).tolist())


def test_seconds_are_medians_over_repeats_and_means_over_views(view: Looked, monkeypatch: pytest.MonkeyPatch) -> None:
    clocks = iter([1.0, 5.0, 3.0])

    def with_clock(view: Looked, order: Any, kind: str | None, clock: Any) -> Refined:
        scale = next(clocks)
        return Refined(flat(0.0), [scale, 2 * scale, 3 * scale], BY_HAND.parts)

    monkeypatch.setattr(anytime, "refined", with_clock)
    found = anytime.measured(view, [("raster", None)], 3)
    assert found["raster", None].seconds.tolist() == [[1.0, 2.0, 3.0], [5.0, 10.0, 15.0], [3.0, 6.0, 9.0]]

    small = replace(view, regions=Regions(2, 2, 1))
    maps = {"point": np.array([1.0, 0.0, 0.0, 0.0])}
    first, second = np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 9.0]]), np.array([[3.0, 4.0, 5.0], [3.0, 8.0, 9.0]])
    runs: Any = {("raster", None): Measured(BY_HAND, first), ("attention", "point"): None}
    other: Any = {("raster", None): Measured(BY_HAND, second), ("attention", "point"): None}
    rough = flat(0.0)
    rough.colour[1, 0] = 9.0
    views = [Seen(small, flat(0.5), rough, maps, runs), Seen(small, flat(0.25), rough, maps, other)]
    curve = anytime.curve(views, "point", "raster")
    assert curve is not None
    assert curve.seconds.tolist() == [[2.0, 3.0, 4.0], [2.0, 5.0, 9.0]], "means over views, repeat by repeat"
    line = curve.anytime
    assert (line.seconds, line.total_spread, line.views) == ([2.0, 4.0, 6.5], (4.0, 9.0), 2)
    assert line.share == [0.0, 0.5, 1.0]
    assert line.rmse_attended == [0.375, 0.125, 0.125], "of the attended pixel, 0: done with the first part"
    assert line.rmse_hardest == [0.375, 0.375, 0.125], "of pixel 2: done with the second part"
    assert anytime.curve(views[:1], "mask", "raster") is None


def test_a_map_costs_what_it_renders(view: Looked) -> None:
    learner, stride, chunk = view.cell.learner, view.stride, view.cell.chunk
    frame = coarse(learner, view.camera, stride, chunk, view.bins)
    rough = coarse(learner, view.camera, stride, chunk, view.bins // 2)
    costs = {kind: attention_of(kind, view)[1] for kind in KINDS}
    there = {kind: attention_of(kind, view, frame.view)[1] for kind in KINDS}
    assert min(frame.network_evaluations, rough.network_evaluations) > 0
    both = frame.network_evaluations + rough.network_evaluations
    free = {"point": 0, "mask": 0, "foveal": 0}
    assert costs == {**free, "gradients": frame.network_evaluations, "error": both}
    assert there == {**free, "gradients": 0, "error": rough.network_evaluations}


def every_evaluation(view: Looked) -> tuple[Looked, list[int]]:
    """The view of a learner that counts, whoever asks it."""
    counted: list[int] = []

    class Counting:
        def render(self, *given: Any) -> Any:
            found = view.cell.learner.render(*given)
            counted.append(found.network_evaluations)
            return found

        def __getattr__(self, name: str) -> Any:
            return getattr(view.cell.learner, name)

    learner: Any = Counting()
    return replace(view, cell=replace(view.cell, learner=learner)), counted


@pytest.mark.parametrize("way", ["even", "samples", "evaluations"])
@pytest.mark.parametrize("kind", ["point", "gradients", "error"])
def test_all_evaluations_of_a_picture_are_counted(view: Looked, way: Any, kind: str) -> None:
    watched, counted = every_evaluation(view)
    budget = allocations.rendered(view, "even", None, 16).evaluations
    found = allocations.rendered(watched, way, kind, 16, budget)
    assert found.evaluations == sum(counted)
    assert (found.own == 0) == (way == "even" or (way, kind) == ("samples", "point"))
    if way == "evaluations":
        assert found.evaluations == pytest.approx(budget, rel=0.15)
        assert found.bins < 16.0, "what it took to find out is taken off"
    else:
        assert 0.95 * 16.0 < found.bins <= 16.0


def test_ways_are_compared_with_the_even_picture(view: Looked, ticks: Ticks) -> None:
    first = plain(view.cell.learner, view.camera, view.cell.chunk)
    maps = {"point": attention_of("point", view, first)[0], "mask": np.ones(view.regions.count)}
    truth = np.zeros((SIZE, SIZE, 3), np.float32)
    one = allocations.sampled(view, maps, 64, 2, truth, ticks)
    found = allocations.allocations([one], "point")
    assert [(row.way, row.against) for row in found] == [
        ("even", 8), ("even", 16), ("even", 32), ("samples", 16), ("evaluations", 16)
    ]  # fmt: skip
    assert {(row.seconds, row.seconds_spread) for row in found} == {(1.0, (1.0, 1.0))}, "one look at the clock each"
    assert len(one.pictures["even", None, 16].seconds) == 2
    assert allocations.allocations([one], "mask") == [], "all alike is the plain picture"
    half, own, twice, *_ = found
    assert twice.rmse_whole < own.rmse_whole < half.rmse_whole, "more samples are nearer to many"
    assert own.truth_whole is not None
    without = replace(one, truth=None)
    blind = allocations.allocations([one, without], "point")[0]
    assert (blind.views, blind.truth_whole, blind.truth_attended) == (2, None, None), "no mean over some of the views"


def test_the_study_is_whole(situation: ServingContext) -> None:
    found = measured_attention(situation)
    assert found is not None
    assert {(one.attention, one.order) for one in found.curves} == {(kind, order) for kind in KINDS for order in ORDERS}
    in_parts = [one for one in found.curves if one.order != "plain"]
    assert {len(one.seconds) for one in in_parts} == {Regions(SIZE, SIZE, found.tile).count + 1}
    assert len(found.reaching) == 3 * len(found.curves)
    assert all(one.seconds is not None for one in found.reaching), "the last part leaves no error"
    assert found.phi.sum_of_priorities == pytest.approx(PHI)
    assert (found.phi.maps, found.phi.orders_changed, found.phi.allocations_changed) == (len(KINDS), 0, 0)
    (plainly,) = found.not_by_regions
    assert plainly.method == "qnerf"
    assert plainly.rmse > 0.0
    for frame in found.frames:
        assert (situation.scratch / "records" / frame.image).is_file()
    assert {frame.title for frame in found.frames} >= {"ground truth", "finished", "coarse frame"}


def test_a_run_of_methods_that_are_not_pointwise_has_no_curves(situation: ServingContext) -> None:
    situation.methods = ["qnerf"]
    assert measured_attention(situation) is None
    assert any("by regions" in sentence for sentence in situation.left_out)


def test_without_its_views_poses_come_from_an_orbit_and_truth_is_left_out(situation: ServingContext) -> None:
    situation.width = 2 * SIZE
    poses = situation.test_poses(situation.scenes[0], 2)
    assert [truth for _, truth in poses] == [None, None]
    assert any("ground truth of ball" in sentence for sentence in situation.left_out)
