"""The standard error of a figure of short trainings, and the loss that it finds: pure functions on arrays.

Cells are [scenes, methods, seeds], weights [scenes, methods]. A figure is the weighted sum, averaged over seeds, of the
amounts by which cells are better than the stored ones of the same seed. Seeds are independent; methods of one seed are
not, as they train on the same batches. The error is one of three:

    rounding   the same program with another order of sums: draws of the stored cells that differ in their last bit
    change     the same random numbers in another program: differences scatter more than rounding, in its pattern
    seeds      other random numbers: each cell is a training with another seed
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from harness.verdicts.statistics import share_found, shift_found

ALIKE = 0.25
"""The share of the variance between seeds below which differences are attributed to the same random numbers. Fewer than
one in a thousand changes with other random numbers lie below it.
"""


@dataclass(frozen=True)
class Error:
    size: float
    freedom: float

    def threshold(self, alarms: float) -> float:
        """Return the one-sided limit, in standard errors, that the share `alarms` of figures exceed (Student)."""
        return float(stdtrit(self.freedom, 1.0 - alarms))

    def limit(self, alarms: float) -> float:
        return self.threshold(alarms) * self.size

    def detects(self, alarms: float) -> float:
        """Return the loss that 80 % of repetitions find, in the figure's unit."""
        return shift_found(self.threshold(alarms), self.freedom) * self.size

    def power(self, loss: float, alarms: float) -> float:
        """Return the share of repetitions that find `loss`."""
        return share_found(loss / self.size, self.threshold(alarms), self.freedom)


def figure(weights: np.ndarray, better_by: np.ndarray) -> float:
    """Return the weighted sum of differences [scenes, methods, seeds]."""
    return float(_by_seed(weights, better_by).mean(axis=1).sum())


def rounding_error(weights: np.ndarray, draws: np.ndarray) -> Error:
    """Return the error of one draw minus the mean of the stored draws [scenes, methods, seeds, draws]."""
    values = _by_seed(weights, draws)
    seeds, many = values.shape[1:]
    variances = values.var(axis=2, ddof=1).mean(axis=1) * (1.0 + 1.0 / many) / seeds
    return _summed(variances, seeds * (many - 1))


def seeds_error(weights: np.ndarray, stored: np.ndarray, seeds: int) -> Error:
    """Return the error of the difference of two sets of `seeds` trainings, from stored [scenes, methods, all seeds]."""
    values = _by_seed(weights, stored)
    return _summed(2.0 * values.var(axis=1, ddof=1) / seeds, values.shape[1] - 1)


def change_error(weights: np.ndarray, draws: np.ndarray, better_by: np.ndarray) -> Error:
    """Return the error of rounding, scaled up to the scatter of the differences [scenes, methods, seeds]. A scene and
    method with a non-finite difference does not count.
    """
    rounding = rounding_error(weights, draws)
    there = np.isfinite(better_by).all(axis=2)
    expected = draws[there].var(axis=2, ddof=1).mean(axis=1) * (1.0 + 1.0 / draws.shape[3])
    seen = better_by[there].var(axis=1, ddof=1)
    further = max(1.0, float(seen.sum() / expected.sum()))
    freedom = _summed(seen, better_by.shape[2] - 1).freedom
    return Error(rounding.size * math.sqrt(further), min(rounding.freedom, freedom))


def alike(better_by: np.ndarray, stored: np.ndarray) -> float:
    """Return the variance of differences [scenes, methods, seeds] about the mean of each scene and method, divided by
    that of two trainings with other seeds, from stored ones [scenes, methods, all seeds].

    A scene and method with a non-finite difference does not count; the result is 1 if none is left.
    """
    there = np.isfinite(better_by).all(axis=2)
    if not there.any():
        return 1.0
    return float(better_by[there].var(axis=1, ddof=1).sum() / (2.0 * stored[there].var(axis=1, ddof=1).sum()))


def _by_seed(weights: np.ndarray, cells: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("sm,smj...->sj...", weights, cells))


def _summed(variances: np.ndarray, freedom: float) -> Error:
    """Return the error of a sum of independent parts with `freedom` degrees of freedom each (Satterthwaite)."""
    total = float(variances.sum())
    if total == 0.0:
        return Error(0.0, freedom)
    return Error(math.sqrt(total), total**2 / float((variances**2).sum()) * freedom)
