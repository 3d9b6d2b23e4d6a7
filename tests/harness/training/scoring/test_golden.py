"""SSIM against scikit-image 0.26.0, whose values are stored here.

skimage.metrics.structural_similarity(truth, image, gaussian_weights=True, sigma=1.5,
                                      use_sample_covariance=False, data_range=1.0, channel_axis=-1)
"""

import numpy as np
import pytest

from harness.training.scoring import metrics


def pattern(height: int, width: int, phase: float) -> np.ndarray:
    row, column, channel = np.meshgrid(np.arange(height), np.arange(width), np.arange(3), indexing="ij")
    return 0.5 + 0.5 * np.sin(0.3 * row + 0.2 * column + channel + phase) * np.cos(0.05 * row * column / (1 + channel))


@pytest.mark.parametrize(
    ("truth", "image", "stored"),
    [
        (pattern(24, 31, 0.4), pattern(24, 31, 0.0), 0.8905031177059787),
        (pattern(17, 40, 1.0), 0.8 * pattern(17, 40, 1.0), 0.9523585756887192),
        (pattern(32, 32, 0.0), 0.5 + 0.25 * np.sign(pattern(32, 32, 0.0) - 0.5), 0.6962176569764997),
        (pattern(11, 11, 0.5), pattern(11, 11, 0.2), 0.88903656152831),
    ],
    ids=["shifted", "darker", "square wave", "one window"],
)
def test_ssim_is_that_of_scikit_image(truth: np.ndarray, image: np.ndarray, stored: float) -> None:
    assert metrics.ssim(image, truth) == pytest.approx(stored, abs=1e-12)
