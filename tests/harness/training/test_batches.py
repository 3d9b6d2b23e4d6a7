"""(seed, step) → batch, and nothing else."""

import numpy as np
import pytest
import torch

from harness.plan.seeds import generator_for
from harness.plan.settings import RayAttention
from harness.training.batches import Batches, Cameras
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
        rays, colours = some.batch(seed, step, count)
        assert colours.dtype == torch.float32
        assert torch.equal(colours, whole[index])
        direct = views.rays(index // size**2, index % size, index % size**2 // size)
        assert torch.equal(rays.directions, direct.directions)
        assert torch.equal(rays.origins, direct.origins)


def patterned(attention: RayAttention) -> Batches:
    """As `batches`, with a third view that alone has gradients."""
    rgba = np.ones((VIEWS, HEIGHT, WIDTH, 4), np.float32)
    rgba[2, ..., 1] = np.arange(WIDTH) % 2
    return Batches(cameras(), ImageStack.of(rgba), attention)


def test_with_attention_half_of_the_rays_go_where_the_training_images_change() -> None:
    some = patterned("gradients")
    rays, colours = some.batch(5, 1, 2000)
    third = cameras().all_rays(2).origins[0]
    from_third = (rays.origins == third).all(dim=-1)
    assert bool(from_third[:1000].all())
    assert 0.25 < float(from_third[1000:].float().mean()) < 0.42
    origins = {tuple(origin) for origin in rays.origins[1000:].tolist()}
    assert len(origins) == VIEWS  # nothing is out of reach
    assert len(colours) == 2000


def test_attended_batches_depend_on_seed_and_step_alone() -> None:
    first = patterned("gradients").batch(5, 1, 64)[0]
    some = patterned("gradients")
    some.batch(5, 2, 64)
    assert torch.equal(some.batch(5, 1, 64)[0].directions, first.directions)
    assert not torch.equal(some.batch(6, 1, 64)[0].directions, first.directions)
    assert not torch.equal(patterned("none").batch(5, 1, 64)[0].directions, first.directions)


def test_images_that_the_cameras_did_not_take_are_refused() -> None:
    for shape in ((VIEWS + 1, HEIGHT, WIDTH, 4), (VIEWS, WIDTH, HEIGHT, 4), (VIEWS, HEIGHT, WIDTH, 3)):
        with pytest.raises(ValueError, match="the cameras need"):
            Batches(cameras(), ImageStack.of(np.zeros(shape, np.float32)))


def test_another_step_or_another_seed_gives_another_batch() -> None:
    some = batches()
    different = {tuple(numbers(some, seed, step)) for seed in range(4) for step in range(4)}
    assert len(different) == 16


def test_the_global_generator_is_left_alone() -> None:
    torch.manual_seed(5)
    expected = torch.rand(3)
    torch.manual_seed(5)
    numbers(batches(), 0, 0)
    assert torch.equal(torch.rand(3), expected)
