"""Transfer functions are compared with their definition, resizing with a simple loop."""

import numpy as np
import pytest

from scenes.view_sets.pixels import (
    area_average,
    area_average_hits,
    area_average_straight,
    decode_srgb,
    display_from_linear,
    encode_srgb,
    over_white,
)


def srgb_of(x: float) -> float:
    return 12.92 * x if x <= 0.0031308 else 1.055 * x ** (1 / 2.4) - 0.055


def averaged_slowly(image: np.ndarray, width: int) -> np.ndarray:
    """Every new pixel cut out of 60 × 60 tiny pieces of each old one, new grid centred on the old."""
    height, old = image.shape[:2]
    scale = old / width
    new_height = max(1, int(height / scale + 1e-9))
    pieces = 60
    fine = np.repeat(np.repeat(image, pieces, 0), pieces, 1)
    result = np.zeros((new_height, width, image.shape[2]))
    top = (height - new_height * scale) / 2
    y, x = (np.arange(height * pieces) + 0.5) / pieces, (np.arange(old * pieces) + 0.5) / pieces
    for i in range(new_height):
        for j in range(width):
            rows = (y >= top + i * scale) & (y < top + (i + 1) * scale)
            columns = (x >= j * scale) & (x < (j + 1) * scale)
            result[i, j] = fine[rows][:, columns].mean((0, 1))
    return result


def test_srgb_is_the_standard_curve() -> None:
    values = [0.0, 0.001, 0.0031308, 0.0032, 0.18, 0.5, 1.0]
    assert np.allclose(encode_srgb(np.array(values)), [srgb_of(x) for x in values], atol=1e-7)
    assert encode_srgb(np.array([-1.0, 2.0])).tolist() == pytest.approx([0.0, 1.0])


def test_srgb_inverts() -> None:
    levels = np.linspace(0, 1, 1001)
    assert np.abs(encode_srgb(decode_srgb(levels)) - levels).max() < 1e-6
    assert decode_srgb(np.array([0.04045]))[0] == pytest.approx(0.04045 / 12.92)


@pytest.mark.parametrize(
    ("height", "width", "new"), [(6, 8, 4), (8, 8, 8), (6, 10, 3), (5, 8, 3), (7, 9, 4), (1, 7, 2)]
)
def test_area_average_is_the_mean_of_the_area(height: int, width: int, new: int) -> None:
    image = np.random.default_rng(height * width).uniform(size=(height, width, 3))
    slow = averaged_slowly(image, new)
    fast = area_average(image, new)
    assert fast.shape == slow.shape
    assert np.abs(fast - slow).max() < 0.02
    if width % new == 0 and height % (width // new) == 0:
        block = width // new
        exact = image.reshape(height // block, block, new, block, 3).mean((1, 3))
        assert np.abs(fast - exact).max() < 1e-12


def test_hidden_colour_does_not_bleed() -> None:
    rgba = np.zeros((2, 2, 4), np.float32)
    rgba[0, 0] = [0.2, 0.4, 0.6, 1.0]
    rgba[1, 1] = [1.0, 0.0, 1.0, 0.0]
    assert area_average_straight(rgba, 1)[0, 0] == pytest.approx([0.2, 0.4, 0.6, 0.25])


def test_resizing_and_compositing_commute() -> None:
    rgba = np.random.default_rng(0).uniform(size=(9, 9, 4)).astype(np.float32)
    assert np.abs(over_white(area_average_straight(rgba, 4)) - area_average(over_white(rgba), 4)).max() < 1e-6


def test_averages_of_hits_exclude_misses() -> None:
    depth = np.array([[4.0, 0.0], [2.0, 0.0]])[..., None]
    coverage = np.array([[1.0, 0.0], [0.5, 0.0]])
    assert area_average_hits(depth, coverage, 1)[0, 0, 0] == pytest.approx((4 + 1) / 1.5)
    assert area_average_hits(depth, np.zeros((2, 2)), 1)[0, 0, 0] == 0


def test_display_of_premultiplied_light() -> None:
    shown = display_from_linear(np.array([[0.09, 0.5, 3.0, 0.5], [0.3, 0.3, 0.3, 0.0]]))
    assert shown[0] == pytest.approx([srgb_of(0.18), 1.0, 1.0, 0.5], abs=1e-6)
    assert shown[1].tolist() == [0.0, 0.0, 0.0, 0.0]
    assert over_white(shown)[1].tolist() == [1.0, 1.0, 1.0]
