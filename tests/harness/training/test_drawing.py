"""Pixels of training images by attention: the chances are Eq. 7's, and the images are not held."""

import numpy as np
import pytest
import torch
from scipy.stats import chisquare

from baselines.numerics.attention import maps
from baselines.numerics.attention.regions import Regions
from harness.training import batches
from harness.training.batches import AttendedPixels, mixed
from scenes.view_sets.pixels import over_white

HEIGHT, WIDTH, TILE = 7, 10, 3


@pytest.fixture(autouse=True)
def small_regions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batches, "REGIONS_ACROSS", 3)


def images(count: int = 3) -> np.ndarray:
    """Straight RGBA; the second one is of one colour."""
    rgba = np.random.default_rng(2).uniform(size=(count, HEIGHT, WIDTH, 4)).astype(np.float32)
    rgba[1] = 0.5
    return rgba


def slow_chances(rgba: np.ndarray) -> np.ndarray:
    """[images · height · width]: each pixel's by the mean gradient of its region."""
    regions = Regions(HEIGHT, WIDTH, TILE)
    attention = np.stack([regions.spread(maps.from_gradients(regions, over_white(one))) for one in rgba])
    return attention.reshape(-1) / attention.sum()


def test_pixels_are_drawn_as_often_as_their_region_is_attended() -> None:
    rgba = images()
    drawn = AttendedPixels.by_gradients(rgba).draw(200_000, torch.Generator().manual_seed(0)).numpy()
    counts, chances = np.bincount(drawn, minlength=rgba[..., 0].size), slow_chances(rgba)
    assert len(counts) == chances.size
    assert (counts[chances == 0.0] == 0).all()
    assert (chances == 0.0).sum() == HEIGHT * WIDTH
    assert chisquare(counts[chances > 0.0], 200_000 * chances[chances > 0.0]).pvalue > 1e-3


def test_images_of_one_colour_are_drawn_from_alike_every_pixel_and_not_every_region() -> None:
    plain = np.full((2, HEIGHT, WIDTH, 4), 0.5, np.float32)
    drawn = AttendedPixels.by_gradients(plain).draw(100_000, torch.Generator().manual_seed(0)).numpy()
    assert chisquare(np.bincount(drawn, minlength=2 * HEIGHT * WIDTH)).pvalue > 1e-3


@pytest.mark.parametrize("count", [1, 2, 7, 64])
def test_half_of_a_batch_is_by_attention_and_the_rest_from_everywhere(count: int) -> None:
    attended = AttendedPixels.by_gradients(images())
    flat = HEIGHT * WIDTH
    drawn = torch.stack([mixed(attended, 3 * flat, count, 0, step) for step in range(400)]).numpy()
    in_plain = (drawn // flat == 1).mean(axis=0)
    half = count // 2
    assert (in_plain[:half] == 0.0).all()
    assert (in_plain[half:] > 0.2).all()
    assert len(drawn[0]) == count
    assert len(set(map(tuple, drawn.tolist()))) > 150 // (1 + (count == 1))


@pytest.mark.parametrize("u", [0.0, 0.5, 1.0 - 2.0**-53])
def test_no_pixel_is_drawn_where_nothing_is_attended(u: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even by the smallest variate, where the first image is of one colour."""
    rgba = images()[[1, 0, 2]]
    monkeypatch.setattr(batches.torch, "rand", lambda *_, **__: torch.full((3, 1), u, dtype=torch.float64))
    drawn = AttendedPixels.by_gradients(rgba).draw(1, torch.Generator())
    assert slow_chances(rgba)[int(drawn)] > 0.0
