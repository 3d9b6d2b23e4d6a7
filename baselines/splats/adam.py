"""A step of Adam (Kingma and Ba 2015, arXiv 1412.6980) in which each Gaussian counts its own steps, compiled for the
processor: torch would walk over memory once for each of a dozen operations.
"""

from typing import NamedTuple, no_type_check

import numpy as np
from numba import njit

ONE = np.float32(1.0)


class Moments(NamedTuple):
    """The state of the optimiser."""

    mean: np.ndarray
    square: np.ndarray
    """The running means of the gradient and of its square [gaussians, columns]."""
    seen: np.ndarray
    """The steps since a Gaussian was made or moved [gaussians, 1]."""


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def step(
    values: np.ndarray, gradient: np.ndarray, moments: Moments, rates: np.ndarray, betas: np.ndarray, epsilon: float,
    out: np.ndarray,
) -> bool:  # fmt: skip
    """Fill `out` with the values after a step, all float32, and renew the moments. Return whether all are finite."""
    total = np.float32(0.0)
    keep_mean, keep_square = betas
    for g in range(values.shape[0]):
        moments.seen[g, 0] += ONE
        of_mean = ONE / (ONE - keep_mean ** moments.seen[g, 0])
        of_square = ONE / (ONE - keep_square ** moments.seen[g, 0])
        row, mean, square, slope, after = values[g], moments.mean[g], moments.square[g], gradient[g], out[g]
        for c in range(row.shape[0]):
            mean[c] = keep_mean * mean[c] + (ONE - keep_mean) * slope[c]
            square[c] = keep_square * square[c] + (ONE - keep_square) * slope[c] * slope[c]
            after[c] = row[c] - rates[c] * of_mean * mean[c] / (np.sqrt(of_square * square[c]) + epsilon)
        for c in range(row.shape[0]):
            total += after[c] - after[c]  # NaN, if it is not finite
    return total == np.float32(0.0)
