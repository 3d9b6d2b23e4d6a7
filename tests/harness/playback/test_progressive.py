"""A view rendered in any parts is the plain view; coarse frames differ as stated."""

from collections.abc import Iterable
from typing import Any, get_args

import numpy as np
import pytest

from baselines.contract import Rays, Rendering
from baselines.numerics.attention import maps
from baselines.numerics.attention.priorities import BadAttention, region_order
from baselines.numerics.attention.regions import Regions
from harness.playback import progressive
from harness.playback.progressive import Canvas, Done, coarse, estimated_error, refine
from harness.training.batches import Camera
from harness.training.learner import Learner
from harness.training.scoring.evaluate import View, render_view
from tests.harness.ball import pose
from tests.harness.patching import changed
from tests.harness.tiny import CPU, train, trainer

CHUNK = 150
BINS = 16
ROUNDING = 2e-6
"""Display colour and opacity, of sums of 16 float32 weights; depth is up to 6 scene units and has six times as much."""
CAMERA = Camera(pose(0.4, 0.5), 22, 18, 24.0, 2.0, 6.0)
REGIONS = Regions(18, 22, 5)
ATTENTION = maps.around_point(REGIONS, 6.0, 14.0, 4.0)
EQUAL = np.full(REGIONS.count, 0.7)


def trained(method: str) -> Learner:
    """Train past the grid's first step, so that empty space is left out and the final number of bins is used."""
    return train(trainer(method), 14)


@pytest.fixture(scope="module")
def nerf() -> Learner:
    learner = trained("nerf")
    assert progressive.why_plain(learner) is None
    assert plain(learner).opacity.max() > 0.05, "it shows something"
    assert plain(learner).colour.std() > 1e-3
    assert learner.rendered_by()["sampling"]["bins"] == BINS
    return learner


@pytest.fixture(scope="module")
def qnerf() -> Learner:
    return trained("qnerf")


def plain(learner: Learner, camera: Camera = CAMERA) -> View:
    return render_view(learner, camera.cameras(CPU), 0, CHUNK)


def same_bits(view: View, other: View) -> bool:
    return all(
        getattr(view, name).tobytes() == getattr(other, name).tobytes() for name in ("colour", "opacity", "depth")
    )


def filled(parts: Iterable[Done]) -> View:
    canvas = Canvas(CAMERA.height, CAMERA.width)
    for done in parts:
        canvas.put(done)
    return canvas.view


def largest_difference(view: View, other: View) -> float:
    colour, opacity = np.abs(view.colour - other.colour).max(), np.abs(view.opacity - other.opacity).max()
    return float(max(colour, opacity, np.abs(view.depth - other.depth).max() / 6.0))


@pytest.mark.parametrize("order", get_args(progressive.Order))
def test_any_order_gives_the_plain_picture_to_the_bit_if_a_method_is_not_pointwise(
    nerf: Learner, qnerf: Learner, order: Any
) -> None:
    view = filled(refine(nerf, CAMERA, REGIONS, ATTENTION, CHUNK, order))
    assert largest_difference(view, plain(nerf)) < ROUNDING
    assert "which points share a chunk" in (progressive.why_plain(qnerf) or "")
    assert same_bits(filled(refine(qnerf, CAMERA, REGIONS, ATTENTION, CHUNK, order)), plain(qnerf))


@pytest.mark.parametrize("attention", [EQUAL, np.zeros(REGIONS.count)])
def test_equal_attention_is_plain_to_the_bit(nerf: Learner, attention: np.ndarray) -> None:
    parts = list(refine(nerf, CAMERA, REGIONS, attention, CHUNK))
    assert same_bits(filled(parts), plain(nerf))
    assert [len(done.pixels) for done in parts] == [150, 150, 96]


@pytest.mark.parametrize("order", get_args(progressive.Order))
@pytest.mark.parametrize("least_rays", [1, 60, 10_000])
def test_every_pixel_comes_once_with_one_part_a_region(nerf: Learner, order: Any, least_rays: int) -> None:
    parts = list(refine(nerf, CAMERA, REGIONS, ATTENTION, CHUNK, order, least_rays))
    assert len(parts) == REGIONS.count
    assert sorted(np.concatenate([done.pixels for done in parts]).tolist()) == list(range(18 * 22))
    shares = np.cumsum([len(done.pixels) for done in parts]) / (18 * 22)
    assert [done.share for done in parts] == shares.tolist()
    assert parts[-1].share == 1.0
    regions = region_order(ATTENTION) if order == "attention" else range(REGIONS.count)
    assert [done.pixels.tolist() for done in parts] == [REGIONS.pixels(int(region)).tolist() for region in regions]


@pytest.fixture
def calls(nerf: Learner, monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int, int | None, int]]:
    """Each call of nerf: its rays, chunk, bins and network evaluations."""
    made = []

    def note(rendering: Rendering, rays: Rays, chunk: int, bins: int | None = None) -> Rendering:
        made.append((len(rays), chunk, bins, rendering.network_evaluations))
        return rendering

    changed(monkeypatch, nerf, "render", note)
    return made


def test_the_evaluations_of_all_parts_are_those_of_all_calls(nerf: Learner) -> None:
    whole = nerf.render(CAMERA.rays(CPU), 10_000).network_evaluations
    for least_rays in (1, 100):
        parts = refine(nerf, CAMERA, REGIONS, ATTENTION, CHUNK, "attention", least_rays)
        assert sum(done.network_evaluations for done in parts) == pytest.approx(whole, rel=0.01)


def test_nothing_is_rendered_before_bad_attention_is_refused(nerf: Learner, calls: list[Any]) -> None:
    bad = ATTENTION.copy()
    bad[3] = np.nan
    for attention, words in (
        (bad, "region 3: attention nan"),
        (ATTENTION[:-1], r"must be \[20\]"),
        (np.zeros(0), r"\[0\]"),
    ):
        with pytest.raises(BadAttention, match=words):
            refine(nerf, CAMERA, REGIONS, attention, CHUNK)
    assert calls == []


@pytest.mark.parametrize("stride", [1, 2, 3, 4, 7, 50])
def test_a_coarse_frame_has_final_pixels_each_spread_over_its_square(
    nerf: Learner, calls: list[Any], stride: int
) -> None:
    view, rays, evaluations = coarse(nerf, CAMERA, stride, CHUNK)
    assert sum(call[-1] for call in calls) == evaluations
    whole = plain(nerf)
    rows, columns = range(0, 18, stride), range(0, 22, stride)
    assert rays == len(rows) * len(columns)
    for top in rows:
        for left in columns:
            row, column = min(top + (stride - 1) // 2, 17), min(left + (stride - 1) // 2, 21)
            for name, tolerance in (("colour", ROUNDING), ("opacity", ROUNDING), ("depth", 6 * ROUNDING)):
                square = getattr(view, name)[top : top + stride, left : left + stride]
                assert np.abs(square - getattr(whole, name)[row, column]).max() < tolerance


def test_the_estimated_error_is_what_half_the_bins_change_and_its_cost_is_counted(
    nerf: Learner, calls: list[Any]
) -> None:
    fine, (rough, rays, evaluations) = (coarse(nerf, CAMERA, 3, CHUNK, bins) for bins in (BINS, BINS // 2))
    calls.clear()
    estimate = estimated_error(nerf, CAMERA, fine.view, 3, CHUNK, BINS)
    square = ((fine.view.colour.astype(float) - rough.colour) ** 2).mean(axis=-1)
    np.testing.assert_allclose(estimate.error**2, square, rtol=1e-12)
    assert estimate.error.max() > 0.0
    assert calls == [(48, CHUNK, BINS // 2, evaluations)]
    assert (estimate.rays, estimate.network_evaluations) == (rays, evaluations) == (48, evaluations)
