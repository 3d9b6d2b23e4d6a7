"""Paired differences, their intervals and their verdicts: pure functions on arrays.

Seeds are nested in scenes: each pair of scene and seed is an independent draw. Such a table answers two questions with
different intervals:

    on these scenes     How large is the mean difference on the scenes that were tried? Its error comes from seeds only.
    scenes like these   How large is it on scenes of this kind? Each scene's mean is one value; Student's t is exact
                        for normal means, however much seeds differ.

The units are never pixels or views.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from msgspec.structs import replace
from scipy.optimize import brentq
from scipy.special import gammainc, stdtr, stdtrit  # scipy.stats takes a second longer to import

from harness.records.cells import Estimate
from harness.records.verdict import OPEN, Sign, Verdict, verdict_of
from harness.verdicts.estimates import nested

CONFIDENCE = 0.95
LEVEL = 0.05
"""The largest adjusted p-value of a known sign."""
LEAST_FREEDOM = 1.0
"""The minimum degrees of freedom of an error with an interval: with fewer, the interval would be useless."""
MOST_FREEDOM = 1e6
POWER = 0.80

NORMAL = np.linspace(-8.0, 8.0, 801)
WEIGHTS = np.exp(-(NORMAL**2) / 2) / np.exp(-(NORMAL**2) / 2).sum()
"""The weights of a standard normal variable on a grid: the trapezoidal rule is almost exact for a smooth integrand."""


@dataclass(frozen=True)
class PairedDifference:
    """A mean of paired differences, with the error that it has and what an `Estimate` says of it."""

    mean: float
    interval: tuple[float, float] | None
    """The two-sided 95 % interval; None with fewer than two units."""
    smallest_detectable: float | None
    units: int
    simultaneous: tuple[float, float] | None = None
    """The interval of a family (Bonferroni); equal to `interval` for a family of one."""
    error: float | None = None
    freedom: float | None = None
    family: int = 1
    effect: float | None = None
    """The mean divided by the standard deviation behind `error`; None if that is 0."""
    p: float | None = None


def paired_difference(differences: np.ndarray, family: int = 1) -> PairedDifference:
    """Estimate the mean of independent differences [units], one of `family` that are judged together. Raises
    `ValueError` if there is none or one is not finite.
    """
    values = np.asarray(differences, dtype=np.float64)
    if values.size == 0 or not np.isfinite(values).all():
        raise ValueError(f"differences must be finite and not empty, got {values}")
    return difference_of(nested.scenes_like_these(values[:, None]), values.size, family)


def on_these_scenes(table: dict[str, np.ndarray], family: int = 1) -> PairedDifference:
    """Estimate the mean over scenes of the means over seeds, with an error from seeds only. `table` maps scene →
    differences [seeds], NaN for a missing one. Raises `ValueError` if it has no difference.
    """
    values = _rows(table)
    return difference_of(nested.on_these_scenes(values), len(values), family)


def on_one_scene(differences: np.ndarray, family: int = 1) -> PairedDifference:
    """Estimate the mean of one scene's differences [seeds], NaN for a missing one, by Student's t, to which
    `on_these_scenes` reduces for one scene. Raises `ValueError` if there is no difference.
    """
    return paired_difference(differences[np.isfinite(differences)], family)


def scenes_like_these(table: dict[str, np.ndarray], family: int = 1) -> PairedDifference:
    """Estimate the same mean for scenes like these: Student's t over the scenes' means, no interval for one scene."""
    values = _rows(table)
    return difference_of(nested.scenes_like_these(values), len(values), family)


def _rows(table: dict[str, np.ndarray]) -> np.ndarray:
    """Return an array [scenes that have a difference, seeds]."""
    there = [values for values in table.values() if np.isfinite(values).any()]
    if not there:
        raise ValueError("no scene has a difference")
    rows = np.full((len(there), max(map(len, there))), np.nan)
    for row, values in zip(rows, there, strict=True):
        row[: len(values)] = values
    return rows


def difference_of(estimates: nested.Estimated, units: int, family: int = 1) -> PairedDifference:
    """Return the difference of one table, estimated from `units`."""
    parts = (estimates.mean, estimates.error, estimates.freedom, estimates.spread)
    mean, error, freedom, spread = map(float, parts)
    if np.isnan(error) or freedom < LEAST_FREEDOM:
        return PairedDifference(mean, None, None, units, family=family)
    freedom = float(rounded_down(freedom))
    alone, together = (critical(freedom, many) * error for many in (1, family))
    detected = shift_found(critical(freedom, family), freedom) * error
    interval, simultaneous = ((mean - half, mean + half) for half in (alone, together))
    effect = mean / spread if spread > 0 else None
    p = float(p_value(mean, error, freedom))
    return PairedDifference(mean, interval, detected, units, simultaneous, error, freedom, family, effect, p)


def rounded_down(freedom: np.ndarray | float) -> np.ndarray:
    """Round down to a tenth, so that cached computations are shared; limited to a value at which t is normal."""
    tenths = np.floor(10 * np.minimum(freedom, MOST_FREEDOM) + 1e-6) / 10
    return np.asarray(np.maximum(tenths, np.minimum(freedom, LEAST_FREEDOM)))


def half_widths(estimates: nested.Estimated, family: int = 1) -> np.ndarray:
    """Return half the widths of the intervals of many estimates, as printed for one; NaN without an interval."""
    values, places = np.unique(rounded_down(estimates.freedom), return_inverse=True)
    factors = np.array([critical(float(value), family) if value >= LEAST_FREEDOM else np.nan for value in values])
    return np.asarray(factors[places.reshape(estimates.freedom.shape)] * estimates.error)


def p_values(estimates: nested.Estimated) -> np.ndarray:
    """Return the two-sided p-values of many estimates, as printed for one; NaN without an interval."""
    known = np.where(estimates.freedom >= LEAST_FREEDOM, rounded_down(estimates.freedom), np.nan)
    return p_value(estimates.mean, estimates.error, known)


def p_value(mean: np.ndarray | float, error: np.ndarray | float, freedom: np.ndarray | float) -> np.ndarray:
    """Return the two-sided probability of an estimate at least as far from 0 as `mean` if the truth is 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        score = np.where(np.asarray(mean) == 0.0, 0.0, np.abs(mean) / np.asarray(error))
    # stdtr of an infinite score is NaN
    return np.asarray(np.where(np.isinf(score), 0.0, 2.0 * stdtr(freedom, -score)))


@lru_cache(maxsize=4096)
def critical(freedom: float, family: int = 1) -> float:
    """Return the half-width, in standard errors, of each of `family` two-sided intervals that hold together in 95 %."""
    return float(stdtrit(freedom, 1.0 - (1.0 - CONFIDENCE) / 2 / family))


def sign_test(ahead: int, behind: int) -> float:
    """Return the two-sided p-value of the exact sign test: the chance that fair coins are at least as unequal."""
    tosses = ahead + behind
    return min(1.0, 2 * sum(math.comb(tosses, heads) for heads in range(min(ahead, behind) + 1)) / (1 << tosses))


def shift_found(threshold: float, freedom: float) -> float:
    """Return the true mean, in standard errors, that 80 % of repetitions find, by the noncentral t distribution.

    A mean is found if it lies beyond `threshold` estimated standard errors, which have `freedom` degrees of freedom.
    """
    # rounded, so that a table and a shifted copy of it share a cache entry
    return _shift_found(float(f"{threshold:.7g}"), float(f"{freedom:.7g}"))


@lru_cache(maxsize=32768)
def _shift_found(threshold: float, freedom: float) -> float:
    high = threshold + 2.0
    while share_found(high, threshold, freedom) < POWER:
        high *= 2.0
    return float(brentq(lambda shift: share_found(shift, threshold, freedom) - POWER, 0.0, high, xtol=1e-9 * high))


def share_found(shift: float, threshold: float, freedom: float) -> float:
    """Return the share of repetitions that find a true mean of `shift` standard errors, by the noncentral t: the mean,
    over possible estimates, of the probability that the estimated error is small enough.
    """
    bound = np.maximum((NORMAL + shift) / threshold, 0.0)  # of the estimated error, in true standard errors
    return float(WEIGHTS @ gammainc(freedom / 2, freedom / 2 * bound**2))


def decided(known: Estimate, adjusted: float, difference: float, smallest_of_interest: float) -> Estimate:
    """Return an estimate with the sign that a procedure for its family decides, by an adjusted p-value of at most 5 %.
    Where that contradicts the simultaneous interval, the interval is made to end at 0.
    """
    interval = known.simultaneous
    if interval is None:
        return known
    sign: Sign = "open"
    if adjusted <= LEVEL and difference:
        sign = "above 0" if difference > 0 else "below 0"
        interval = (max(interval[0], 0.0), interval[1]) if difference > 0 else (interval[0], min(interval[1], 0.0))
    else:
        interval = min(interval[0], 0.0), max(interval[1], 0.0)
    size = verdict_of(interval, smallest_of_interest).size
    return replace(known, p_adjusted=adjusted, simultaneous=interval, verdict=Verdict(sign, size))


def estimate(result: PairedDifference, smallest_of_interest: float, settled: bool = True) -> Estimate:
    """Return the record of an estimate; unless it is `settled`, its verdict is open and it has no p-value."""
    answer, p = (verdict_of(result.simultaneous, smallest_of_interest), result.p) if settled else (OPEN, None)
    adjusted = None if p is None else min(1.0, p * result.family)
    detectable = result.smallest_detectable
    return Estimate(result.interval, result.simultaneous, result.family, answer, detectable, result.effect, p, adjusted)
