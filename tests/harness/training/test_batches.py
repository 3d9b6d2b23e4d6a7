"""(seed, step) → batch, and nothing else."""

import numpy as np
import pytest
import torch

from harness.machine.stopwatch import Stopwatch
from harness.plan.seeds import generator_for
from harness.training.batches import Batches, Cameras, covered_pixels
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.pixels import over_white
from tests.harness.ball import pose

VIEWS, HEIGHT, WIDTH = 3, 4, 5
PIXELS = VIEWS * HEIGHT * WIDTH


def cameras() -> Cameras:
    return Cameras.of(np.array([pose(0.7 * i, 0.3) for i in range(VIEWS)]), WIDTH, HEIGHT, 5.0, 2.0, 6.0)


def batches() -> Batches:
    """The first channel of a pixel's colour is its number; nothing shows through."""
    rgba = np.ones((VIEWS, HEIGHT, WIDTH, 4), np.float32)
    rgba[..., 0] = np.arange(PIXELS).reshape(VIEWS, HEIGHT, WIDTH)
    return Batches(cameras(), ImageStack.of(rgba))


def numbers(some: Batches, seed: int, step: int, count: int = 40) -> list[int]:
    return some.batch(seed, step, count)[1][:, 0].int().tolist()


def test_the_same_seed_and_step_give_the_same_batch_whatever_came_before() -> None:
    first = numbers(batches(), 3, 17)
    other = batches()
    torch.manual_seed(99)
    for step in (17, 2, 18, 5):
        numbers(other, 3, step)
    assert numbers(other, 3, 17) == first


def test_batches_are_those_of_all_views_composited_in_memory_to_the_bit() -> None:
    size = 50
    rgba = np.random.default_rng(0).uniform(size=(VIEWS, size, size, 4)).astype(np.float32)
    rgba[..., 3] = np.where(rgba[..., 3] < 0.3, 0.0, np.minimum(1.2 * rgba[..., 3], 1.0))
    views = Cameras.of(np.array([pose(0.7 * i, 0.3) for i in range(VIEWS)]), size, size, 60.0, 2.0, 6.0)
    some = Batches(views, ImageStack.of(rgba))
    whole = torch.as_tensor(over_white(rgba), dtype=torch.float32).reshape(-1, 3)
    for seed, step, count in ((0, 0, 512), ("lego/2", 31, 1024), (3, 1199, 1)):
        index = torch.randint(len(whole), (count,), generator=generator_for(seed, step, "batch"))
        rays, colours, *_ = some.batch(seed, step, count)
        assert colours.dtype == torch.float32
        assert torch.equal(colours, whole[index])
        direct = views.rays(index // size**2, index % size, index % size**2 // size)
        assert torch.equal(rays.directions, direct.directions)
        assert torch.equal(rays.origins, direct.origins)


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
    views = Cameras.of(np.array([pose(0.7 * i, 0.3) for i in range(VIEWS)]), size, size, 60.0, 2.0, 6.0)
    return Batches(views, ImageStack.of(rgba), share)


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


def test_images_with_nothing_covered_are_drawn_from_evenly() -> None:
    empty = ImageStack.of(np.zeros((VIEWS, HEIGHT, WIDTH, 4), np.float32))
    assert len(Batches(cameras(), empty, 0.8).batch(0, 0, 40)[1]) == 40


def test_where_all_is_covered_every_pixel_has_the_same_chance() -> None:
    given = batches().rgba
    drawn = np.bincount(numbers(Batches(cameras(), given, 0.8), 0, 0, 60_000), minlength=PIXELS)
    assert 850 < drawn.min() <= drawn.max() < 1150


def test_images_that_the_cameras_did_not_take_are_refused() -> None:
    for shape in ((VIEWS + 1, HEIGHT, WIDTH, 4), (VIEWS, WIDTH, HEIGHT, 4), (VIEWS, HEIGHT, WIDTH, 3)):
        with pytest.raises(ValueError, match="the cameras need"):
            Batches(cameras(), ImageStack.of(np.zeros(shape, np.float32)))


def test_the_global_generator_is_left_alone() -> None:
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    numbers(batches(), 0, 0)
    assert torch.equal(torch.rand(3), expected)
