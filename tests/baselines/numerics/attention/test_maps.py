"""Maps of attention against their closed forms; what is said of a region is said of its pixels."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from baselines.numerics.attention import maps
from baselines.numerics.attention.priorities import BadAttention, region_order
from baselines.numerics.attention.regions import Regions

REGIONS = Regions(12, 20, 4)
PIXELS = Regions(9, 15, 1)
"""Regions of a pixel each: a map is then the formula itself."""


def test_a_mask_counts_its_share_of_each_region() -> None:
    mask = np.zeros((12, 20), bool)
    mask[0:4, 0:4] = True
    mask[4, 4:8] = True
    found = maps.mean_attention(REGIONS, mask, "mask")
    assert found.dtype == np.float64
    assert found.tolist() == [1.0, *[0.0] * 5, 0.25, *[0.0] * 8]


def test_a_point_of_interest_is_half_at_its_radius_and_falls_with_distance_everywhere() -> None:
    found = maps.around_point(PIXELS, 4.5, 7.5, 2.0).reshape(9, 15)
    assert found[4, 7] == 1.0
    assert found[4, 9] == found[4, 5] == found[2, 7] == found[6, 7] == pytest.approx(0.5)
    far = maps.around_point(PIXELS, 0.5, 0.5, 1e-3)
    row, column = np.divmod(np.arange(PIXELS.count), 15)
    assert region_order(far).tolist() == np.argsort(row**2 + column**2, kind="stable").tolist()


def test_the_fovea_is_the_formula_at_the_angle_between_two_rays() -> None:
    focal, gaze = 11.0, (2.5, 10.25)
    found = maps.foveal(PIXELS, *gaze, focal).reshape(9, 15)
    at = np.array([gaze[1] - 7.5, gaze[0] - 4.5, focal])
    for row, column in ((0, 0), (2, 10), (8, 14), (4, 7)):
        ray = np.array([column + 0.5 - 7.5, row + 0.5 - 4.5, focal])
        degrees = math.degrees(math.acos(ray @ at / np.linalg.norm(ray) / np.linalg.norm(at)))
        assert found[row, column] == pytest.approx(1.0 / (1.0 + degrees / 2.3), rel=1e-9)
    assert maps.foveal(PIXELS, 4.5, 7.5, focal).max() == 1.0


def test_gradients_of_a_slope_are_the_slope() -> None:
    row, column = np.mgrid[0:12, 0:20]
    np.testing.assert_allclose(maps.from_gradients(REGIONS, 3.0 * row + 4.0 * column), 5.0, rtol=1e-12)
    both = np.stack([3.0 * row, 4.0 * column, np.ones((12, 20))], axis=-1)
    np.testing.assert_allclose(maps.from_gradients(REGIONS, both), 5.0, rtol=1e-12)


def test_gradients_are_where_the_edge_is() -> None:
    image = np.zeros((12, 20, 3), np.float32)
    image[:, 10:] = 1.0
    found = maps.from_gradients(REGIONS, image).reshape(3, 5)
    assert (found[:, 2] > 0.0).all()
    assert (found[:, [0, 1, 3, 4]] == 0.0).all()


def test_an_image_of_one_colour_or_one_pixel_attends_to_nothing() -> None:
    assert (maps.from_gradients(REGIONS, np.full((12, 20, 3), 0.3)) == 0.0).all()
    assert maps.from_gradients(Regions(1, 1, 4), np.ones((1, 1, 3))).tolist() == [0.0]


@pytest.mark.parametrize("value", [-1e-9, np.nan, np.inf, -np.inf])
def test_a_pixel_that_is_no_attention_is_named_even_where_the_mean_would_hide_it(value: float) -> None:
    values = np.ones((12, 20))
    values[5, 17] = value
    with pytest.raises(BadAttention, match=rf"error: region 9 has {value:g} at row 5, column 17"):
        maps.mean_attention(REGIONS, values, "error")


def test_an_image_that_is_not_finite_is_refused() -> None:
    image = np.zeros((12, 20, 3))
    image[6, 6, 1] = np.nan
    with pytest.raises(BadAttention, match="gradient: region"):
        maps.from_gradients(REGIONS, image)


def test_points_and_lenses_that_are_none_are_refused() -> None:
    for row, column in ((np.nan, 1.0), (1.0, np.inf)):
        with pytest.raises(BadAttention, match="must be finite"):
            maps.around_point(REGIONS, row, column, 1.0)
        with pytest.raises(BadAttention, match="must be finite"):
            maps.foveal(REGIONS, row, column, 10.0)
    for size in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(BadAttention, match="radius"):
            maps.around_point(REGIONS, 1.0, 1.0, size)
        with pytest.raises(BadAttention, match="focal length"):
            maps.foveal(REGIONS, 1.0, 1.0, size)


def test_a_map_renders_only_what_it_looks_at() -> None:
    asked: list[str] = []

    def given(name: str, value: np.ndarray) -> Callable[[], np.ndarray]:
        return lambda: asked.append(name) or value  # type: ignore[func-returns-value]

    flat = np.ones((12, 20))
    sight = maps.MapInputs(
        REGIONS, 6.0, 10.0, 4.0, 20.0, given("mask", flat), given("image", flat), given("error", flat)
    )
    seen = {}
    for name, found in maps.MAPS.items():
        asked.clear()
        assert found(sight).shape == (REGIONS.count,)
        seen[name] = list(asked)
    assert seen == {"point": [], "mask": ["mask"], "gradients": ["image"], "error": ["error"], "foveal": []}
    with pytest.raises(BadAttention, match="nothing of that kind"):
        maps.MAPS["mask"](maps.MapInputs(REGIONS, 6.0, 10.0, 4.0, 20.0))


# regions

SIZES = [(8, 8, 4), (7, 10, 3), (1, 1, 5), (5, 1, 2), (3, 9, 1), (4, 6, 100)]


@pytest.mark.parametrize(("height", "width", "tile"), SIZES)
def test_every_pixel_lies_in_one_region_and_means_are_those_of_its_pixels(height: int, width: int, tile: int) -> None:
    regions = Regions(height, width, tile)
    together = np.concatenate([regions.pixels(region) for region in range(regions.count)])
    assert sorted(together.tolist()) == list(range(height * width))
    assert regions.rays.tolist() == [len(regions.pixels(region)) for region in range(regions.count)]
    for region in range(regions.count):
        assert set(regions.of_pixel.reshape(-1)[regions.pixels(region)]) == {region}
    values = np.random.default_rng(1).uniform(size=(height, width))
    slow = [values.reshape(-1)[regions.pixels(region)].mean() for region in range(regions.count)]
    np.testing.assert_allclose(regions.mean(values), slow, rtol=1e-14)


def test_regions_are_squares_numbered_row_by_row() -> None:
    regions = Regions(5, 7, 3)
    assert (regions.columns, regions.count) == (3, 6)
    assert regions.pixels(1).tolist() == [3, 4, 5, 10, 11, 12, 17, 18, 19]
    assert regions.pixels(5).tolist() == [27, 34]


@pytest.mark.parametrize("value", [0.1, 1e300, 1.7e308, 1e-300, 5e-324, 0.0])
def test_equal_values_have_exactly_equal_means(value: float) -> None:
    regions = Regions(11, 13, 3)
    assert set(regions.mean(np.full((11, 13), value)).tolist()) == {value}


def test_values_of_another_picture_and_sizes_of_none_are_refused() -> None:
    with pytest.raises(BadAttention, match=r"mask \[10, 7\]: the picture is \[7, 10\]"):
        maps.mean_attention(Regions(7, 10, 3), np.ones((10, 7)), "mask")
    for sizes in ((0, 3, 1), (3, 0, 1), (3, 3, 0)):
        with pytest.raises(ValueError, match="at least 1"):
            Regions(*sizes)
