"""Scores against closed forms and slow, obvious references."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from harness.training.scoring import metrics


def random_image(height: int, width: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((height, width, 3))


@pytest.mark.parametrize("difference", [1.0, 0.5, 0.1, 1e-3])
def test_psnr_of_a_constant_difference_is_minus_20_log10_of_it(difference: float) -> None:
    truth = np.full((4, 5, 3), 0.25)
    assert metrics.mse(truth + difference, truth) == pytest.approx(difference**2)
    assert metrics.psnr(truth + difference, truth) == pytest.approx(-20 * math.log10(difference))


def test_psnr_is_of_the_mean_over_pixels_and_channels() -> None:
    truth = np.zeros((2, 2, 3))
    image = truth.copy()
    image[0, 1, 2] = 0.6
    assert metrics.psnr(image, truth) == pytest.approx(-10 * math.log10(0.36 / 12))


def test_scores_are_taken_in_double_precision() -> None:
    truth = np.full((64, 64, 3), 0.9, dtype=np.float32)
    image = truth + np.float32(1e-4)
    expected = float(np.mean((image.astype(float) - truth.astype(float)) ** 2))
    assert metrics.mse(image, truth) == pytest.approx(expected, rel=1e-12)


def test_identical_images_have_the_best_score_of_each_kind() -> None:
    image = random_image(16, 16).astype(np.float32)
    assert metrics.psnr(image, image) == math.inf
    assert metrics.ssim(image, image) == pytest.approx(1.0, abs=1e-12)
    assert metrics.flip(image, image) == 0.0
    assert metrics.delta_e(image, image) == 0.0
    assert metrics.rmse_linear(image, image) == 0.0


def test_rmse_linear_decodes_both_images_first() -> None:
    grey, black = np.full((3, 3, 3), 0.5), np.zeros((3, 3, 3))
    assert metrics.rmse_linear(grey, black) == pytest.approx(((0.5 + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("light", [0.0, 0.25, 40.0, 1e6])
def test_errors_relative_to_unclipped_light_are_closed_forms_of_a_constant_pair(light: float) -> None:
    truth = np.full((5, 4, 3), light)
    for factor in (0.0, 0.5, 1.0, 3.0):
        image, off = factor * truth, abs(factor - 1.0) * light
        assert metrics.rel_mse(image, truth) == pytest.approx(off**2 / (light**2 + 0.01))
        assert metrics.smape(image, truth) == pytest.approx(off / ((1.0 + factor) * light + 0.01))


def test_relative_errors_see_what_display_colour_clips() -> None:
    truth, image = np.full((16, 16, 3), 50.0), np.full((16, 16, 3), 1.0)
    assert metrics.rel_mse(image, truth) > 0.9
    assert metrics.smape(image, truth) > 0.9
    assert metrics.hdr_flip(image, truth) > 0.1
    assert metrics.hdr_flip(truth, truth) == metrics.rel_mse(truth, truth) == metrics.smape(truth, truth) == 0.0


LIGHT = [metrics.rel_mse, metrics.smape, metrics.hdr_flip]
SCORES = [*LIGHT, metrics.mse, metrics.psnr, metrics.ssim, metrics.flip, metrics.delta_e, metrics.rmse_linear]


@pytest.mark.parametrize("score", SCORES)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("spoilt", [0, 1])
def test_no_score_of_a_value_that_is_not_finite(score: Callable[..., float], bad: float, spoilt: int) -> None:
    images = [random_image(12, 12, 0), random_image(12, 12, 1)]
    images[spoilt][3, 4, 1] = bad
    with pytest.raises(ValueError, match="1 values are not finite"):
        score(*images)


@pytest.mark.parametrize("score", SCORES)
def test_no_score_of_images_of_different_sizes(score: Callable[..., float]) -> None:
    with pytest.raises(ValueError, match="shapes differ"):
        score(random_image(12, 12), random_image(12, 1))


# SSIM


def slow_ssim(x: np.ndarray, y: np.ndarray) -> float:
    """Wang et al. 2004, window by window with an explicit two-dimensional Gaussian; scikit-image gives the same."""
    size = min(11, x.shape[0], x.shape[1])
    middle = (size - 1) / 2
    window = np.array(
        [[math.exp(-((i - middle) ** 2 + (j - middle) ** 2) / (2 * 1.5**2)) for j in range(size)] for i in range(size)]
    )
    window /= window.sum()
    values = []
    for row in range(x.shape[0] - size + 1):
        for column in range(x.shape[1] - size + 1):
            for channel in range(3):
                a = x[row : row + size, column : column + size, channel]
                b = y[row : row + size, column : column + size, channel]
                mean_a, mean_b = (window * a).sum(), (window * b).sum()
                var_a, var_b = (window * (a - mean_a) ** 2).sum(), (window * (b - mean_b) ** 2).sum()
                covariance = (window * (a - mean_a) * (b - mean_b)).sum()
                luminance = (2 * mean_a * mean_b + 0.01**2) / (mean_a**2 + mean_b**2 + 0.01**2)
                structure = (2 * covariance + 0.03**2) / (var_a + var_b + 0.03**2)
                values.append(luminance * structure)
    return float(np.mean(values))


@pytest.mark.parametrize("size", [(11, 11), (16, 13), (24, 24), (11, 30), (10, 12), (5, 7), (2, 9), (1, 1), (1, 8)])
def test_ssim_equals_a_slow_reference(size: tuple[int, int]) -> None:
    truth = random_image(*size, seed=1)
    image = np.clip(truth + 0.2 * (random_image(*size, seed=2) - 0.5), 0, 1)
    assert metrics.ssim(image, truth) == pytest.approx(slow_ssim(image, truth), abs=1e-10)


# FLIP and CIEDE2000


def test_flip_lies_between_0_and_1_and_falls_with_the_error() -> None:
    truth = random_image(24, 24).astype(np.float32)
    errors = [metrics.flip(np.clip(truth + amount, 0, 1), truth) for amount in (0.02, 0.1, 0.5)]
    assert 0 < errors[0] < errors[1] < errors[2] <= 1
    assert metrics.flip(np.zeros((24, 24, 3)), np.ones((24, 24, 3))) == pytest.approx(1.0, abs=0.05)


def ciede2000(first: tuple[float, ...], second: tuple[float, ...]) -> float:
    """Sharma, Wu and Dalal 2005, one pair of Lab colours, equation by equation; their table has the same."""
    (l1, a1, b1), (l2, a2, b2) = first, second
    mean_c = (math.hypot(a1, b1) + math.hypot(a2, b2)) / 2
    g = 0.5 * (1 - math.sqrt(mean_c**7 / (mean_c**7 + 25**7)))
    a1, a2 = (1 + g) * a1, (1 + g) * a2
    c1, c2 = math.hypot(a1, b1), math.hypot(a2, b2)
    h1, h2 = (math.degrees(math.atan2(b, a)) % 360 if (a, b) != (0, 0) else 0.0 for a, b in ((a1, b1), (a2, b2)))
    dh = 0.0 if c1 * c2 == 0 else (h2 - h1 + 180) % 360 - 180
    big_dh = 2 * math.sqrt(c1 * c2) * math.sin(math.radians(dh / 2))
    mean_l, mean_c = (l1 + l2) / 2, (c1 + c2) / 2
    if c1 * c2 == 0:
        h = h1 + h2
    elif abs(h1 - h2) <= 180:
        h = (h1 + h2) / 2
    else:
        h = (h1 + h2 + 360) / 2 if h1 + h2 < 360 else (h1 + h2 - 360) / 2

    def cosine(degrees: float) -> float:
        return math.cos(math.radians(degrees))

    t = 1 - 0.17 * cosine(h - 30) + 0.24 * cosine(2 * h) + 0.32 * cosine(3 * h + 6) - 0.20 * cosine(4 * h - 63)
    s_l = 1 + 0.015 * (mean_l - 50) ** 2 / math.sqrt(20 + (mean_l - 50) ** 2)
    s_c, s_h = 1 + 0.045 * mean_c, 1 + 0.015 * mean_c * t
    turn = math.sin(math.radians(60 * math.exp(-(((h - 275) / 25) ** 2))))
    r_t = -turn * 2 * math.sqrt(mean_c**7 / (mean_c**7 + 25**7))
    lightness, chroma, hue = (l2 - l1) / s_l, (c2 - c1) / s_c, big_dh / s_h
    return math.sqrt(lightness**2 + chroma**2 + hue**2 + r_t * chroma * hue)


def lab_of(display: np.ndarray) -> tuple[float, ...]:
    """IEC 61966-2-1 and CIE 1976 for one sRGB colour, white D65."""
    linear = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in display.tolist()]
    matrix = [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
    white = [sum(row) for row in matrix]
    x, y, z = (sum(m * v for m, v in zip(row, linear, strict=True)) / w for row, w in zip(matrix, white, strict=True))

    def f(t: float) -> float:
        return t ** (1 / 3) if t > (6 / 29) ** 3 else t / (3 * (6 / 29) ** 2) + 4 / 29

    return 116 * f(y) - 16, 500 * (f(x) - f(y)), 200 * (f(y) - f(z))


def test_delta_e_equals_a_pixel_by_pixel_reference() -> None:
    truth, image = random_image(6, 5, seed=3), random_image(6, 5, seed=4)
    expected = np.mean(
        [
            ciede2000(lab_of(a), lab_of(b))
            for a, b in zip(image.reshape(-1, 3), truth.reshape(-1, 3), strict=True)
        ]
    )  # fmt: skip
    assert metrics.delta_e(image, truth) == pytest.approx(float(expected), rel=2e-3)


def test_delta_e_of_black_and_white_is_100_and_clips_what_a_screen_cannot_show() -> None:
    white, black = np.ones((2, 2, 3)), np.zeros((2, 2, 3))
    assert metrics.delta_e(black, white) == pytest.approx(100.0, abs=1e-2)
    assert metrics.delta_e(2.0 * white, white) == 0.0


# geometry


def test_depth_counts_the_truly_opaque_pixels_alone() -> None:
    truth = np.array([[2.0, 3.0], [0.0, 5.0]])
    depth = np.array([[2.5, 3.0], [6.0, 3.0]])
    opaque = np.array([[True, True], [False, False]])
    assert metrics.depth_rmse(depth, truth, opaque) == pytest.approx(math.sqrt(0.25 / 2))
    assert metrics.depth_rmse(depth, truth, np.zeros((2, 2), dtype=bool)) is None


def test_geometry_that_is_not_finite_has_no_score() -> None:
    with pytest.raises(ValueError, match="not finite"):
        metrics.depth_rmse(np.array([[2.0, math.nan]]), np.ones((1, 2)), np.ones((1, 2), dtype=bool))
    with pytest.raises(ValueError, match="not finite"):
        metrics.opacity_iou(np.array([[math.nan]]), np.array([[1.0]]))


@pytest.mark.parametrize(
    ("ours", "theirs", "expected"),
    [
        ([1, 1, 0, 0], [1, 1, 0, 0], 1.0),
        ([1, 1, 0, 0], [0, 1, 1, 0], 1 / 3),
        ([1, 0, 0, 0], [0, 0, 0, 1], 0.0),
        ([0.51, 0.5, 0.49, 0], [1, 1, 0, 0], 0.5),
        ([0, 0, 0, 0], [0, 0, 0, 0.5], None),
    ],
)
def test_opacity_iou(ours: list[float], theirs: list[float], expected: float | None) -> None:
    shapes = [np.array(one, dtype=float).reshape(2, 2) for one in (ours, theirs)]
    assert metrics.opacity_iou(*shapes) == (None if expected is None else pytest.approx(expected))
