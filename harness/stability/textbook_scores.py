"""Scores as textbooks print them, without what keeps them finite."""

import numpy as np


def textbook_scores(image: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """PSNR of an error that may be 0, and SSIM of whole images [h, w, 3] without its two constants."""
    x, y = image.astype(np.float64), truth.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        psnr = -10.0 * np.log10(np.mean((x - y) ** 2))
        mean_x, mean_y = x.mean(), y.mean()
        covariance = ((x - mean_x) * (y - mean_y)).mean()
        structure = 2 * mean_x * mean_y * 2 * covariance
        ssim = structure / ((mean_x**2 + mean_y**2) * (x.var() + y.var()))
    return {"psnr": float(psnr), "ssim": float(ssim)}
