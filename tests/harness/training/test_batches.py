"""(seed, step) → batch, and nothing else; pixels → rays, against `CONVENTIONS.md` and a loop over pixels."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from harness.machine.stopwatch import Stopwatch
from harness.plan.seeds import generator_for
from harness.training.batches import Batches, Camera, Cameras, covered_pixels
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.pixels import over_white
from tests.harness.ball import pose
from tests.harness.tiny import CPU

POSES = np.array([pose(0.3, 0.2), pose(2.0, 0.9), pose(-1.0, -0.4)])
VIEWS, HEIGHT, WIDTH = len(POSES), 4, 5
PIXELS = VIEWS * HEIGHT * WIDTH


def cameras(width: int = WIDTH, height: int = HEIGHT, focal: float = 6.5) -> Cameras:
    return Cameras.of(POSES, width, height, focal, 2.0, 6.0)


def batches(value: float = 1.0, covered_share: float = 0.0) -> Batches:
    """All channels of all pixels have one value."""
    return Batches(cameras(), ImageStack.of(np.full((VIEWS, HEIGHT, WIDTH, 4), value, np.float32)), covered_share)


def test_batches_are_those_of_all_views_composited_in_memory_to_the_bit_whatever_came_before() -> None:
    size = 50
    rgba = np.random.default_rng(0).uniform(size=(VIEWS, size, size, 4)).astype(np.float32)
    rgba[..., 3] = np.where(rgba[..., 3] < 0.3, 0.0, np.minimum(1.2 * rgba[..., 3], 1.0))
    views = cameras(size, size, 60.0)
    some = Batches(views, ImageStack.of(rgba))
    whole = torch.as_tensor(over_white(rgba), dtype=torch.float32).reshape(-1, 3)
    before = torch.get_rng_state()
    for seed, step, count in ((0, 0, 512), ("lego/2", 31, 1024), (3, 1199, 1), (0, 0, 512)):
        index = torch.randint(len(whole), (count,), generator=generator_for(seed, step, "batch"))
        rays, colours, *_ = some.batch(seed, step, count)
        assert colours.dtype == torch.float32
        assert torch.equal(colours, whole[index])
        direct = views.rays(index // size**2, index % size, index % size**2 // size)
        assert torch.equal(rays.directions, direct.directions)
        assert torch.equal(rays.origins, direct.origins)
    assert torch.equal(torch.get_rng_state(), before), "the global generator is left alone"


def test_a_batch_brings_the_time_of_its_making_also_where_it_was_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    readings = iter(range(100))
    monkeypatch.setattr(
        "harness.training.batches.Stopwatch",
        lambda device: Stopwatch(device, lambda: float(next(readings) ** 2), lambda: 10.0 * next(readings)),
    )
    some = batches()
    first = some.batch(0, 0, 40)
    assert (first.seconds, first.core_seconds) == (2.0**2 - 0.0, 10.0 * (3 - 1))
    assert some.batch(0, 0, 40) is first
    view = some.for_learner(True, 0, 40)(0)
    assert (view.seconds, view.core_seconds) == (6.0**2 - 4.0**2, 10.0 * (7 - 5))


def one_dot(share: float) -> Batches:
    """Three images, 100 pixels wide, with one covered pixel in the last of them."""
    size = 100
    rgba = np.zeros((VIEWS, size, size, 4), np.float32)
    rgba[2, 50, 60, 3] = 1.0
    return Batches(cameras(size, size, 60.0), ImageStack.of(rgba), share)


def test_four_rays_in_five_go_through_covered_pixels_or_near_them_and_the_others_anywhere() -> None:
    some = one_dot(0.8)
    assert sorted(covered_pixels(some.rgba)) == [
        20_000 + row * 100 + column for row in range(48, 53) for column in range(58, 63)
    ]
    rays = some.batch(5, 1, 5000)[0]
    from_third = (rays.origins == cameras().all_rays(2).origins[0]).all(dim=-1)
    assert bool(from_third[:4000].all())
    assert len({tuple(d) for d in rays.directions[:4000].tolist()}) == 25
    assert 0.27 < float(from_third[4000:].float().mean()) < 0.40
    assert len({tuple(d) for d in rays.directions[4000:].tolist()}) > 900


def edged() -> tuple[Batches, np.ndarray]:
    """Three covered images with random colours in one corner; returns the chance of each pixel too, by a slow loop."""
    rgba = np.ones((VIEWS, HEIGHT, WIDTH, 4), np.float32)
    rgba[:, :2, :3, :3] = np.random.default_rng(1).uniform(size=(VIEWS, 2, 3, 3))
    contrast = np.zeros((VIEWS, HEIGHT, WIDTH))
    for view, row, column in np.ndindex(contrast.shape):
        near = rgba[view, max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2, :3].reshape(-1, 3)
        contrast[view, row, column] = (near.max(axis=0) - near.min(axis=0)).max()
    chance = 1.0 + 3.0 * contrast / contrast.mean()
    return Batches(cameras(), ImageStack.of(rgba), 1.0, 3.0), (chance / chance.sum()).ravel()


def test_covered_pixels_are_drawn_in_proportion_to_one_plus_three_times_their_relative_contrast() -> None:
    some, chance = edged()
    assert chance.max() > 3.0 * chance.min()
    drawn = some._places(200_000, generator_for(0, 0, "batch")).numpy()
    counts = np.bincount(some._covered[drawn], minlength=PIXELS)
    deviations = (counts - 200_000 * chance) / np.sqrt(200_000 * chance)
    assert np.abs(deviations).max() < 4.5
    assert 0.5 < np.mean(deviations**2) < 1.7


def test_without_contrast_anywhere_covered_pixels_have_equal_chances() -> None:
    flat = ImageStack.of(np.full((VIEWS, HEIGHT, WIDTH, 4), 0.5, np.float32))
    plain, weighted = Batches(cameras(), flat, 1.0), Batches(cameras(), flat, 1.0, 3.0)
    for one, other in zip(plain.batch(0, 0, 50)[0].directions, weighted.batch(0, 0, 50)[0].directions, strict=True):
        assert torch.equal(one, other)


def test_images_that_are_held_and_images_that_are_read_give_the_same_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    held, _ = edged()
    monkeypatch.setattr("harness.training.batches.RESIDENT_BYTES", 0)
    read, _ = edged()
    assert (held._resident is None, read._resident is None) == (False, True)
    for step in range(3):
        one, in_turns = held.batch(7, step, 64), held.for_learner(False, 7, 64, in_turns=True)(step)
        for other in (read.batch(7, step, 64), in_turns):
            assert torch.equal(one.colours, other.colours)
            assert torch.equal(one.rays.directions, other.rays.directions)
        assert in_turns.seconds == 0.0


@pytest.mark.parametrize("alpha", [0.0, 1.0])
def test_where_nothing_or_all_is_covered_every_pixel_has_the_same_chance(alpha: float) -> None:
    rays, *_ = batches(alpha, 0.8).batch(0, 0, 60_000)
    _, drawn = torch.cat([rays.origins, rays.directions], dim=-1).unique(dim=0, return_counts=True)
    assert len(drawn) == PIXELS
    assert 850 < drawn.min() <= drawn.max() < 1150


def test_images_that_the_cameras_did_not_take_are_refused() -> None:
    for shape in ((VIEWS + 1, HEIGHT, WIDTH, 4), (VIEWS, WIDTH, HEIGHT, 4), (VIEWS, HEIGHT, WIDTH, 3)):
        with pytest.raises(ValueError, match="the cameras need"):
            Batches(cameras(), ImageStack.of(np.zeros(shape, np.float32)))


# pixels → rays; one camera, and what no picture can be taken with


def slow_direction(matrix: np.ndarray, column: int, row: int, width: int, height: int, focal: float) -> list[float]:
    """One pixel in double precision: right, down, forward."""
    right = (column + 0.5 - width / 2) / focal
    down = (row + 0.5 - height / 2) / focal
    d = [right * matrix[i, 0] - down * matrix[i, 1] - matrix[i, 2] for i in range(3)]
    length = math.sqrt(sum(x * x for x in d))
    return [x / length for x in d]


@pytest.mark.parametrize("size", [(5, 5), (6, 4), (1, 3)])
def test_rays_equal_a_loop_over_pixels(size: tuple[int, int]) -> None:
    width, height = size
    some = cameras(width, height)
    for view, matrix in enumerate(POSES):
        rays = some.all_rays(view)
        assert len(rays) == width * height
        expected = [
            slow_direction(matrix, column, row, width, height, some.focal)
            for row in range(height)
            for column in range(width)
        ]
        np.testing.assert_allclose(rays.directions.numpy(), expected, atol=1e-6)
        np.testing.assert_allclose(rays.origins.numpy(), np.tile(matrix[:3, 3], (len(rays), 1)), rtol=1e-6)
        assert (rays.near, rays.far) == (2.0, 6.0)


def test_the_pixels_of_a_call_may_be_of_several_views() -> None:
    some = cameras(4, 4)
    view, column, row = torch.tensor([0, 2, 1]), torch.tensor([3, 0, 1]), torch.tensor([0, 3, 2])
    directions = some.rays(view, column, row).directions
    for i in range(3):
        alone = some.all_rays(int(view[i])).directions[int(row[i]) * 4 + int(column[i])]
        assert torch.equal(directions[i], alone)


CAMERA = Camera(POSES[1], 8, 6, 9.0, 2.0, 6.0)


def test_the_rays_of_one_camera_are_those_of_the_views() -> None:
    ours, theirs = CAMERA.rays(CPU), cameras(8, 6, 9.0).all_rays(1)
    assert torch.equal(ours.origins, theirs.origins)
    assert torch.equal(ours.directions, theirs.directions)
    assert (ours.near, ours.far) == (2.0, 6.0)


def test_resized_sees_the_same_between_the_same_corners() -> None:
    half, same = CAMERA.resized(4), CAMERA.resized(8)
    assert (half.width, half.height, half.focal) == (4, 3, 4.5)
    assert (same.width, same.height, same.focal) == (8, 6, 9.0)
    assert (CAMERA.resized(1).width, CAMERA.resized(1).height) == (1, 1)
    assert replace(CAMERA, width=100, height=1).resized(10).height == 1
    np.testing.assert_array_equal(half.camera_to_world, POSES[1])


def test_its_pose_cannot_be_changed_from_outside() -> None:
    given = POSES[1].copy()
    lens = CAMERA.at(given)
    given[0, 0] = 7.0
    np.testing.assert_array_equal(lens.camera_to_world, POSES[1])
    with pytest.raises(ValueError, match="read-only"):
        lens.camera_to_world[0, 0] = 7.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"camera_to_world": np.eye(3)}, "4 × 4"), ({"camera_to_world": np.full((4, 4), np.nan)}, "finite"),
        ({"width": 0}, "0 × 6"), ({"height": -1}, "8 × -1"), ({"focal": 0.0}, "focal length 0.0"),
        ({"focal": math.nan}, "focal length nan"), ({"focal": math.inf}, "focal length inf"),
        ({"near": -1.0}, "near -1.0"), ({"near": 6.0}, "near 6.0"), ({"near": math.nan}, "near nan"),
        ({"far": math.inf}, "far inf"),
    ],
)  # fmt: skip
def test_what_no_picture_can_be_taken_with_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        replace(CAMERA, **changes)
