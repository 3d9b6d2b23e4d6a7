"""Image and geometry scores, pure functions on arrays. Images are display colour over white, float [h, w, 3].

Every score refuses values that are not finite: a NaN pixel has no score (FLIP would give it 0.97).
"""

import numpy as np
from scipy.ndimage import correlate1d

from scenes.view_sets.pixels import decode_srgb

SSIM_WINDOW = 11
SSIM_SIGMA = 1.5


def mse(image: np.ndarray, truth: np.ndarray) -> float:
    """Return the mean squared difference; raises `ValueError` if a value is not finite or the shapes differ."""
    _require_finite(image, truth)
    return float(np.mean((image.astype(np.float64) - truth.astype(np.float64)) ** 2))


def psnr_from_mse(error: float) -> float:
    """Return −10 log10(mse) for a peak of 1; infinite for identical images."""
    return float("inf") if error == 0.0 else float(-10.0 * np.log10(error))


def psnr(image: np.ndarray, truth: np.ndarray) -> float:
    """Return the peak signal-to-noise ratio in dB."""
    return psnr_from_mse(mse(image, truth))


def rmse_linear(image: np.ndarray, truth: np.ndarray) -> float:
    _require_finite(image, truth)
    return float(np.sqrt(mse(decode_srgb(image), decode_srgb(truth))))


def ssim_kernel(height: int, width: int) -> np.ndarray:
    """Return the weights of the window along one side, which sum to 1, for an image of this size."""
    window = min(SSIM_WINDOW, height, width)
    offsets = np.arange(window) - (window - 1) / 2
    kernel = np.exp(-0.5 * (offsets / SSIM_SIGMA) ** 2)
    return kernel / kernel.sum()  # type: ignore[no-any-return]


def ssim(image: np.ndarray, truth: np.ndarray) -> float:
    """Return the structural similarity as usual for radiance fields (Wang et al. 2004): 11 × 11 Gaussian window of
    σ = 1.5, only valid windows, averaged over channels. For a smaller image the image is the window.
    """
    _require_finite(image, truth)
    x, y = image.astype(np.float64), truth.astype(np.float64)
    kernel = ssim_kernel(*x.shape[:2])
    window = len(kernel)

    def blurred(values: np.ndarray) -> np.ndarray:
        half, rows, columns = window // 2, x.shape[0] - window + 1, x.shape[1] - window + 1
        return np.asarray(
            correlate1d(correlate1d(values, kernel, axis=0), kernel, axis=1)[half : half + rows, half : half + columns]
        )

    mean_x, mean_y = blurred(x), blurred(y)
    variance_x = np.maximum(blurred(x * x) - mean_x**2, 0.0)
    variance_y = np.maximum(blurred(y * y) - mean_y**2, 0.0)
    covariance = blurred(x * y) - mean_x * mean_y
    c1, c2 = 0.01**2, 0.03**2
    luminance = (2 * mean_x * mean_y + c1) / (mean_x**2 + mean_y**2 + c1)
    structure = (2 * covariance + c2) / (variance_x + variance_y + c2)
    return float(np.mean(luminance * structure))


def flip(image: np.ndarray, truth: np.ndarray) -> float:
    """Return the mean FLIP error (Andersson et al. 2020), 0 to 1, at the default 67 pixels per degree."""
    _require_finite(image, truth)
    return _flip(np.clip(image, 0.0, 1.0), np.clip(truth, 0.0, 1.0), "LDR")


def _flip(image: np.ndarray, truth: np.ndarray, kind: str) -> float:
    import flip_evaluator

    reference, test = (side.astype(np.float32) for side in (truth, image))
    _, mean, _ = flip_evaluator.evaluate(reference, test, kind, applyMagma=False, computeMeanError=True)
    return float(mean)


def delta_e(image: np.ndarray, truth: np.ndarray) -> float:
    """Return the mean CIEDE2000 colour difference (D65), by colour-science."""
    _require_finite(image, truth)
    import colour

    first, second = (
        colour.XYZ_to_Lab(colour.RGB_to_XYZ(decode_srgb(np.clip(side, 0.0, 1.0)), "sRGB")) for side in (image, truth)
    )
    return float(np.mean(colour.delta_E(first, second, method="CIE 2000")))


LIGHT_FLOOR = 0.01
"""The constant that keeps relative errors of dark pixels finite, in units of the light of display white."""


def rel_mse(light: np.ndarray, truth: np.ndarray) -> float:
    """Return the mean of (x − t)² / (t² + 0.01), linear light that need not lie below 1 (Rousselle et al. 2011)."""
    _require_finite(light, truth)
    x, t = light.astype(np.float64), truth.astype(np.float64)
    return float(np.mean((x - t) ** 2 / (t**2 + LIGHT_FLOOR)))


def smape(light: np.ndarray, truth: np.ndarray) -> float:
    """Return the symmetric mean absolute percentage error |x − t| / (|x| + |t| + 0.01) of linear light, 0 to 1."""
    _require_finite(light, truth)
    x, t = light.astype(np.float64), truth.astype(np.float64)
    return float(np.mean(np.abs(x - t) / (np.abs(x) + np.abs(t) + LIGHT_FLOOR)))


def hdr_flip(light: np.ndarray, truth: np.ndarray) -> float:
    """Return the mean HDR-FLIP error of linear light (Andersson et al. 2021), 0 to 1; it chooses the exposures."""
    _require_finite(light, truth)
    return _flip(np.maximum(light, 0.0), np.maximum(truth, 0.0), "HDR")


def depth_rmse(depth: np.ndarray, truth: np.ndarray, opaque: np.ndarray) -> float | None:
    """Return the root mean squared depth error in scene units over the truly opaque pixels; None if there are none."""
    if not opaque.any():
        return None
    _require_finite(depth, truth[opaque])
    return float(np.sqrt(np.mean((depth[opaque] - truth[opaque]) ** 2)))


def opacity_iou(opacity: np.ndarray, truth: np.ndarray) -> float | None:
    """Return the intersection over union of the silhouettes (opacity above one half); None if both are empty."""
    _require_finite(opacity, truth)
    shown, true = opacity > 0.5, truth > 0.5
    union = np.count_nonzero(shown | true)
    return float(np.count_nonzero(shown & true) / union) if union else None


def _require_finite(*arrays: np.ndarray) -> None:
    shapes = {array.shape for array in arrays}
    if len(shapes) > 1 and all(array.ndim >= 2 for array in arrays):
        raise ValueError(f"shapes differ: {sorted(map(str, shapes))}")
    for array in arrays:
        if not np.isfinite(array).all():
            raise ValueError(f"{np.count_nonzero(~np.isfinite(array))} values are not finite: no score exists")
