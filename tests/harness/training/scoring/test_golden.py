"""PSNR and SSIM against scikit-image 0.26.0 and torchmetrics 1.9.0, whose values are stored here.

skimage.metrics.structural_similarity(truth, image, gaussian_weights=True, sigma=1.5,
                                      use_sample_covariance=False, data_range=1.0, channel_axis=-1)
torchmetrics.functional.image.structural_similarity_index_measure(image, truth, data_range=1.0)   # in double
"""

import numpy as np
import pytest

from harness.training.scoring import metrics


def pattern(height: int, width: int, phase: float) -> np.ndarray:
    row, column, channel = np.meshgrid(np.arange(height), np.arange(width), np.arange(3), indexing="ij")
    return 0.5 + 0.5 * np.sin(0.3 * row + 0.2 * column + channel + phase) * np.cos(0.05 * row * column / (1 + channel))


PAIRS = {
    "shifted": (pattern(24, 31, 0.4), pattern(24, 31, 0.0)),
    "darker": (pattern(17, 40, 1.0), 0.8 * pattern(17, 40, 1.0)),
    "square wave": (pattern(32, 32, 0.0), 0.5 + 0.25 * np.sign(pattern(32, 32, 0.0) - 0.5)),
    "one window": (pattern(11, 11, 0.5), pattern(11, 11, 0.2)),
}
"""Truth and image."""
# fmt: off
STORED = {
    "shifted": (19.619217085671515, 19.61921619575853, 0.8905031177059787, 0.8810111542684782),
    "darker": (19.069659025401727, 19.06965816041628, 0.9523585756887192, 0.9523719452299276),
    "square wave": (16.32608202128975, 16.326081280750902, 0.6962176569764997, 0.6823869218921063),
    "one window": (21.44974890147847, 21.449747928533927, 0.88903656152831, 0.9031411547464596),
}
"""PSNR of scikit-image and torchmetrics (which rounds it to single precision), then SSIM of both."""
# fmt: on


@pytest.mark.parametrize("pair", PAIRS)
def test_psnr_is_that_of_scikit_image_and_torchmetrics(pair: str) -> None:
    truth, image = PAIRS[pair]
    assert metrics.psnr(image, truth) == pytest.approx(STORED[pair][0], abs=1e-12)
    assert metrics.psnr(image, truth) == pytest.approx(STORED[pair][1], abs=2e-6)


@pytest.mark.parametrize("pair", PAIRS)
def test_ssim_is_that_of_scikit_image(pair: str) -> None:
    truth, image = PAIRS[pair]
    assert metrics.ssim(image, truth) == pytest.approx(STORED[pair][2], abs=1e-12)


@pytest.mark.parametrize("pair", PAIRS)
def test_torchmetrics_reflects_the_images_at_their_borders_where_ours_leaves_windows_out(pair: str) -> None:
    wider = [np.pad(side, ((5, 5), (5, 5), (0, 0)), mode="reflect") for side in PAIRS[pair]]
    assert metrics.ssim(wider[1], wider[0]) == pytest.approx(STORED[pair][3], abs=1e-12)
