"""Every pixel lies in one region, and what is said of a region is said of its pixels."""

import numpy as np
import pytest

from baselines.numerics.attention.regions import Regions

SIZES = [(8, 8, 4), (7, 10, 3), (1, 1, 5), (5, 1, 2), (3, 9, 1), (4, 6, 100)]


@pytest.mark.parametrize(("height", "width", "tile"), SIZES)
def test_every_pixel_lies_in_exactly_one_region(height: int, width: int, tile: int) -> None:
    regions = Regions(height, width, tile)
    together = np.concatenate([regions.pixels(region) for region in range(regions.count)])
    assert sorted(together.tolist()) == list(range(height * width))
    assert regions.rays.tolist() == [len(regions.pixels(region)) for region in range(regions.count)]
    for region in range(regions.count):
        assert set(regions.of_pixel.reshape(-1)[regions.pixels(region)]) == {region}


def test_regions_are_squares_numbered_row_by_row() -> None:
    regions = Regions(5, 7, 3)
    assert (regions.rows, regions.columns, regions.count) == (2, 3, 6)
    assert regions.pixels(1).tolist() == [3, 4, 5, 10, 11, 12, 17, 18, 19]
    assert regions.pixels(5).tolist() == [27, 34]
    assert regions.corner(5) == (3, 6, 2, 1)


@pytest.mark.parametrize(("height", "width", "tile"), SIZES)
def test_means_are_those_of_the_pixels(height: int, width: int, tile: int) -> None:
    regions = Regions(height, width, tile)
    values = np.random.default_rng(1).uniform(size=(height, width))
    slow = [values.reshape(-1)[regions.pixels(region)].mean() for region in range(regions.count)]
    np.testing.assert_allclose(regions.mean(values), slow, rtol=1e-14)


@pytest.mark.parametrize("value", [0.1, 1e300, 1.7e308, 1e-300, 5e-324, 0.0])
def test_equal_values_have_exactly_equal_means(value: float) -> None:
    regions = Regions(11, 13, 3)
    assert set(regions.mean(np.full((11, 13), value)).tolist()) == {value}


def test_spread_is_the_inverse_of_the_mean() -> None:
    regions = Regions(7, 10, 3)
    values = np.arange(1.0, regions.count + 1)
    assert regions.spread(values).shape == (7, 10)
    np.testing.assert_allclose(regions.mean(regions.spread(values)), values, rtol=1e-15)


def test_values_of_another_picture_are_refused() -> None:
    regions = Regions(7, 10, 3)
    with pytest.raises(ValueError, match="the picture is 7 × 10"):
        regions.mean(np.ones((10, 7)))
    with pytest.raises(ValueError, match="12 regions"):
        regions.spread(np.ones(11))
    for sizes in ((0, 3, 1), (3, 0, 1), (3, 3, 0)):
        with pytest.raises(ValueError, match="at least 1"):
            Regions(*sizes)
