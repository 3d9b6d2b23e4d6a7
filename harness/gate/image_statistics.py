"""Renders against a stored mean and variance: pure functions on arrays.

Images are `[batches, height, width, 4]`, linear and premultiplied; a batch is one independent render.
"""

from dataclasses import dataclass

import numpy as np

LARGEST_SQUARE = 25.0
"""A pixel's squared deviation is cut there, so that the mean is about all pixels; single ones have a test of their own.
"""


@dataclass(frozen=True)
class Reference:
    """What a scene is known to look like."""

    mean: np.ndarray
    """float64 [height, width, 4]."""
    variance: np.ndarray
    """float64 [height, width, 4]: of one render of `spp` samples."""
    batches: int
    """Renders that both were made of."""
    spp: int

    def __post_init__(self) -> None:
        """Raises `ValueError` for what cannot be compared with."""
        if not (np.isfinite(self.mean).all() and np.isfinite(self.variance).all() and (self.variance >= 0).all()):
            raise ValueError("mean or variance is not finite, or a variance is below 0")
        if self.mean.shape != self.variance.shape or not self.mean[..., :3].any():
            raise ValueError(f"mean {self.mean.shape} and variance {self.variance.shape} do not fit, or all is black")

    @staticmethod
    def of(renders: np.ndarray, spp: int) -> "Reference":
        x = np.asarray(renders, dtype=np.float64)
        return Reference(x.mean(axis=0), x.var(axis=0, ddof=1), len(x), spp)

    def variances(self) -> np.ndarray:
        """The stored variance as if one sample more, as bright as the brightest pixel, had hit every pixel once.

        A pixel that a surface touches by a hair may have been missed by all samples of the reference: its variance
        is then 0, and the first hit would be infinitely unlikely.
        """
        return self.variance + (self.mean.max() / self.spp) ** 2 / self.batches


def biases(renders: np.ndarray, reference: Reference) -> np.ndarray:
    """How much brighter each render is than the reference, in % [batches]: the least-squares slope of its colour over
    the reference's, pixels weighted by their precision, less 1."""
    r = reference.mean[..., :3]
    weighted = r / reference.variances()[..., :3]
    difference = np.asarray(renders, dtype=np.float64)[..., :3] - r
    return 100.0 * np.einsum("hwc,bhwc->b", weighted, difference) / float((weighted * r).sum())


def mean_square(renders: np.ndarray, reference: Reference) -> float:
    """Mean over pixels and channels of the squared deviation of the renders' mean, in standard errors, each cut at 25.

    Well below 1 where nothing differs: empty pixels and the opacity of full ones count and do not deviate, and the
    floor of `variances` makes dark ones deviate by less. What is usual for a scene is measured, not derived.
    """
    z2 = standardised(renders, reference) ** 2
    # a pixel that is not finite makes the whole so: np.minimum hands NaN on
    return float(np.minimum(z2, LARGEST_SQUARE).mean())


def standardised(renders: np.ndarray, reference: Reference) -> np.ndarray:
    """Deviation of the renders' mean from the reference's [height, width, 4], in standard errors of both."""
    x = np.asarray(renders, dtype=np.float64)
    return (x.mean(axis=0) - reference.mean) / np.sqrt(reference.variances() * (1 / len(x) + 1 / reference.batches))


def largest(renders: np.ndarray, reference: Reference) -> np.ndarray:
    """The largest deviation of any pixel of each render [batches], in standard deviations of one render."""
    x = np.asarray(renders, dtype=np.float64)
    z = np.abs(x - reference.mean) / np.sqrt(reference.variances() * (1 + 1 / reference.batches))
    return z.max(axis=(1, 2, 3))


def pooled(by_scene: list[np.ndarray], spreads: list[float]) -> np.ndarray:
    """Biases [batches] of several scenes as one, scenes weighted by their precision."""
    weights = np.array(spreads, dtype=np.float64) ** -2.0
    return np.asarray(np.einsum("s,sb->b", weights / weights.sum(), np.stack(by_scene)))
