"""Paired differences, their intervals and their verdicts: pure functions on arrays."""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from scipy.stats import nct
from scipy.stats import t as student

Verdict = Literal["better", "worse", "equivalent", "inconclusive"]

CONFIDENCE = 0.95
POWER = 0.80


@dataclass(frozen=True)
class PairedDifference:
    """Mean of paired differences with a two-sided 95 % interval (Student), and what this many pairs can detect."""

    mean: float
    interval: tuple[float, float] | None
    """None with fewer than two units: one difference has no spread."""
    smallest_detectable: float | None
    """The true difference that such a sample, with this spread, would tell from 0 in 80 % of repetitions."""
    units: int


def paired_difference(differences: np.ndarray) -> PairedDifference:
    """From independent differences [units]; raises `ValueError` where there is none or one is not finite."""
    values = np.asarray(differences, dtype=np.float64)
    if values.size == 0 or not np.isfinite(values).all():
        raise ValueError(f"differences must be finite and not empty, got {values}")
    mean, units = float(values.mean()), int(values.size)
    if units < 2:
        return PairedDifference(mean, None, None, units)
    error = float(values.std(ddof=1)) / units**0.5
    half = float(student.ppf(0.5 + CONFIDENCE / 2, units - 1)) * error
    return PairedDifference(mean, (mean - half, mean + half), detectable_in_errors(units) * error, units)


@cache
def detectable_in_errors(units: int) -> float:
    """Smallest detectable effect of a paired t-test in standard errors of the mean, by the noncentral t."""
    freedom = units - 1
    critical = student.ppf(0.5 + CONFIDENCE / 2, freedom)
    low, high = 0.0, 200.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        power = nct.sf(critical, freedom, middle)
        low, high = (middle, high) if power < POWER else (low, middle)
    return high


def over_scenes(differences: dict[str, np.ndarray]) -> PairedDifference:
    """One difference a scene, its mean over seeds: scenes are the units, as a claim is about scenes not seen yet.

    With a single scene its seeds are the units.
    """
    if len(differences) == 1:
        return paired_difference(next(iter(differences.values())))
    return paired_difference(np.array([values.mean() for values in differences.values()]))


def verdict(result: PairedDifference, smallest_of_interest: float, higher_is_better: bool) -> Verdict:
    """What the interval allows to say.

    equivalent    the whole interval lies within ± the smallest effect of interest
    better/worse  the interval does not hold 0
    inconclusive  anything else, and whatever has no interval
    """
    if result.interval is None:
        return "inconclusive"
    low, high = result.interval
    if -smallest_of_interest < low and high < smallest_of_interest:
        return "equivalent"
    if low > 0:
        return "better" if higher_is_better else "worse"
    if high < 0:
        return "worse" if higher_is_better else "better"
    return "inconclusive"
