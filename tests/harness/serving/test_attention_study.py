"""Curves, allocations and φ, against sums by hand and on a tiny field."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from harness.attention.priorities import PHI
from harness.attention.progressive import Done
from harness.attention.regions import Regions
from harness.evaluate import View
from harness.finished import TrainedCell
from harness.serving import allocations, anytime
from harness.serving.anytime import Measured, Refined, Seen, attended_pixels, errors_along, reaching, refined, runs_of
from harness.serving.attention_maps import KINDS, Looked, attention_of, middle
from harness.serving.attention_study import STRIDE, measured_attention, tile_of
from harness.serving.situation import Situation, plain
from harness.serving_record import Anytime
from tests.harness.serving.conftest import Ticks
from tests.harness.trained_runs import SIZE


def flat(value: float, height: int = 2, width: int = 2) -> View:
    shape = (height, width)
    return View(np.full((*shape, 3), value, np.float32), np.ones(shape, np.float32), np.ones(shape, np.float32))


def done(pixels: list[int], value: float, share: float) -> Done:
    ones = np.full(len(pixels), value, np.float32)
    return Done(None, np.array(pixels), np.repeat(ones[:, None], 3, axis=1), ones, ones, share, 1)


BY_HAND = Refined(flat(0.0), [1.0, 2.0, 4.0], [done([0, 1], 0.5, 0.5), done([2, 3], 0.5, 1.0)])


def test_errors_fall_part_by_part() -> None:
    attended = np.array([False, False, True, False])
    found = list(errors_along(BY_HAND, flat(0.5), attended))
    assert found == [(0.5, 0.5), (0.5, pytest.approx(0.5 * np.sqrt(0.5))), (0.0, 0.0)]


def test_an_error_that_is_not_finite_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        list(errors_along(BY_HAND, flat(float("nan")), np.ones(4, dtype=bool)))


@pytest.mark.parametrize(("limit", "colours"), [(0.5, [0, 0, 0, 0]), (2.0, [1, 1, 0, 0]), (9.0, [1, 1, 1, 1])])
def test_a_frame_shows_what_was_done_in_time(limit: float, colours: list[int]) -> None:
    picture = Measured(BY_HAND, BY_HAND.seconds).after(limit).colour[..., 0].reshape(-1)
    assert (2 * picture).tolist() == colours
    assert BY_HAND.first.colour.max() == 0.0, "the coarse frame is left as it was"


def curve_of(errors: list[float]) -> Anytime:
    seconds = [0.5 * (place + 1) for place in range(len(errors))]
    return Anytime("ball", "nerf", "point", "raster", 1, seconds, [0.0] * len(errors), errors, errors)


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
    found = reaching(curve_of(errors), 0.5)
    assert found.seconds == seconds
    assert found.share_of_time == (None if seconds is None else pytest.approx(seconds / (0.5 * len(errors))))


def test_the_attended_quarter_is_that_of_the_most_attended_regions() -> None:
    regions = Regions(4, 4, 2)
    found = attended_pixels(regions, np.array([0.1, 0.0, 3.0, 0.2])).reshape(4, 4)
    assert found[2:, :2].all()
    assert found.sum() == 4


def test_the_mask_is_a_quarter_of_the_picture() -> None:
    found = middle(8, 12)
    assert found.sum() == 8 * 12 / 4
    assert found[2:6, 3:9].all()


@pytest.fixture
def view(situation: Situation, cell: TrainedCell) -> Looked:
    camera = situation.camera(cell, situation.orbit(cell.scene, 1)[0])
    return Looked(cell, camera, Regions(SIZE, SIZE, tile_of(SIZE)), STRIDE, 16)


@pytest.mark.parametrize("order", ["attention", "raster", "spread"])
def test_every_order_ends_in_the_plain_picture(view: Looked, ticks: Ticks, order: Any) -> None:
    found = refined(view, order, "foveal" if order == "attention" else None, ticks)
    assert np.diff(found.seconds).tolist() == [1.0] * len(found.parts), "one look at the clock a part"
    assert len(found.parts) == view.regions.count
    wanted = plain(view.cell.learner, view.camera, view.cell.chunk)
    np.testing.assert_allclose(found.at(len(found.parts)).colour, wanted.colour, atol=1e-5)
    *_, last = errors_along(found, wanted, np.ones(SIZE * SIZE, dtype=bool))
    assert max(last) < 1e-5


def test_by_attention_the_attended_quarter_is_done_first(view: Looked) -> None:
    found = refined(view, "attention", "point")
    first = plain(view.cell.learner, view.camera, view.cell.chunk)
    attended = attended_pixels(view.regions, attention_of("point", view, first))
    early = np.concatenate([part.pixels for part in found.parts[: view.regions.count // 4]])
    assert set(early.tolist()) == set(np.flatnonzero(attended).tolist())


def test_a_map_that_attends_to_all_alike_has_no_run_of_its_own() -> None:
    assert runs_of({"point": np.array([1.0, 2.0]), "mask": np.ones(2), "error": np.zeros(2)}) == [
        ("attention", "point"), ("raster", None), ("spread", None)
    ]  # fmt: skip


def test_seconds_are_medians_over_repeats_and_means_over_views(view: Looked, monkeypatch: pytest.MonkeyPatch) -> None:
    clocks = iter([1.0, 5.0, 3.0])

    def with_clock(view: Looked, order: Any, kind: str | None, clock: Any) -> Refined:
        scale = next(clocks)
        return Refined(flat(0.0), [scale, 2 * scale, 3 * scale], BY_HAND.parts)

    monkeypatch.setattr(anytime, "refined", with_clock)
    found = anytime.measured(view, [("raster", None)], 3)
    assert found["raster", None].seconds == [3.0, 6.0, 9.0]

    small = replace(view, regions=Regions(2, 2, 1))
    maps = {"point": np.array([1.0, 0.0, 0.0, 0.0])}
    runs: Any = {("raster", None): Measured(BY_HAND, [1.0, 2.0, 3.0]), ("attention", "point"): None}
    other: Any = {("raster", None): Measured(BY_HAND, [3.0, 4.0, 5.0]), ("attention", "point"): None}
    curve = anytime.curve([Seen(small, flat(0.5), maps, runs), Seen(small, flat(0.25), maps, other)], "point", "raster")
    assert curve is not None
    assert (curve.seconds, curve.views) == ([2.0, 3.0, 4.0], 2)
    assert curve.share == [0.0, 0.5, 1.0]
    assert curve.rmse_attended == [0.375, 0.125, 0.125], "of the attended pixel, 0: done with the first part"
    assert anytime.curve([Seen(small, flat(0.5), maps, runs)], "mask", "raster") is None


def test_samples_are_as_many_with_and_without_attention(view: Looked, ticks: Ticks) -> None:
    first = plain(view.cell.learner, view.camera, view.cell.chunk)
    maps = {"point": attention_of("point", view, first), "mask": np.ones(view.regions.count)}
    truth = np.zeros((SIZE, SIZE, 3), np.float32)
    one = allocations.sampled(view, maps, [8], 16, 64, truth, ticks)
    even, attended = allocations.allocations([one], "point", 8)
    assert (even.by_attention, attended.by_attention) == (False, True)
    assert even.bins == 8.0
    assert attended.bins == pytest.approx(8.0)
    assert even.seconds == attended.seconds == 1.0
    assert attended.evaluations > 0
    assert allocations.allocations([one], "mask", 8) == [], "all alike is the plain picture"
    (more,) = allocations.allocations([one], "point", 16)
    assert (more.by_attention, more.bins) == (False, 16.0)
    assert more.rmse_whole < even.rmse_whole, "more samples are nearer to many"
    assert even.truth_whole is not None
    without = replace(one, truth=None)
    (blind, _) = allocations.allocations([one, without], "point", 8)
    assert (blind.views, blind.truth_whole, blind.truth_attended) == (2, None, None), "no mean over some of the views"


def test_the_study_is_whole(situation: Situation) -> None:
    found = measured_attention(situation)
    assert found is not None
    assert {(one.attention, one.order) for one in found.curves} == {
        (kind, order) for kind in KINDS for order in ("attention", "raster", "spread")
    }
    assert {len(one.seconds) for one in found.curves} == {Regions(SIZE, SIZE, found.tile).count + 1}
    assert len(found.reaching) == 2 * len(found.curves)
    assert all(one.seconds is not None for one in found.reaching), "the last part leaves no error"
    assert found.phi.sum_of_priorities == pytest.approx(PHI)
    assert (found.phi.maps, found.phi.orders_changed, found.phi.allocations_changed) == (len(KINDS), 0, 0)
    (plainly,) = found.not_by_regions
    assert plainly.method == "qnerf"
    assert plainly.rmse > 0.0
    for frame in found.frames:
        assert (situation.run.out / "records" / frame.image).is_file()
    assert {frame.title for frame in found.frames} >= {"ground truth", "finished", "coarse frame"}


def test_a_run_of_methods_that_are_not_pointwise_has_no_curves(situation: Situation) -> None:
    situation.methods = ["qnerf"]
    assert measured_attention(situation) is None
    assert any("by regions" in sentence for sentence in situation.left_out)


def test_without_its_views_poses_come_from_an_orbit_and_truth_is_left_out(situation: Situation) -> None:
    situation.width = 2 * SIZE
    poses = situation.test_poses(situation.scenes[0], 2)
    assert [truth for _, truth in poses] == [None, None]
    assert any("ground truth of ball" in sentence for sentence in situation.left_out)
