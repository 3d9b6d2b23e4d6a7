"""Paired differences, their intervals and their verdicts: pure functions on arrays.

Seeds are nested in scenes: every scene and seed is a draw of its own. Two questions can be asked of such a table, and
their intervals are not the same:

    on these scenes     how large is the mean difference on the scenes that were tried? Error comes from seeds alone.
    scenes like these   how large is it on scenes of this kind? Each scene's mean is one value, and Student's t is
                        exact for normal ones, however much seeds differ.

Pixels or views are never the units.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammainc, stdtr, stdtrit  # scipy.stats takes a second longer to import

from harness.records.cells import Estimate
from harness.records.verdict import OPEN, Verdict, verdict_of
from harness.verdicts.estimates import nested

CONFIDENCE = 0.95
LEAST_FREEDOM = 1.0
"""The least degrees of freedom of an error with an interval: with fewer it would reach beyond every scale."""
MOST_FREEDOM = 1e6
POWER = 0.80

NORMAL = np.linspace(-8.0, 8.0, 801)
WEIGHTS = np.exp(-(NORMAL**2) / 2) / np.exp(-(NORMAL**2) / 2).sum()
"""The weights of a standard normal variable on a grid: the trapezoidal rule is all but exact for a smooth integrand."""


@dataclass(frozen=True)
class PairedDifference:
    """A mean of paired differences, its two-sided 95 % interval, and what such a sample can detect."""

    mean: float
    interval: tuple[float, float] | None
    """The 95 % interval; None with fewer than two units: one difference has no spread."""
    smallest_detectable: float | None
    """The true difference that 80 % of such samples tell from 0, if the true spread is the one measured here."""
    units: int
    simultaneous: tuple[float, float] | None = None
    """The interval that a verdict is taken from: of all the family's intervals of this kind, every one holds the truth
    in 95 % of repetitions (Bonferroni). Equal to `interval` for a family of one."""
    error: float | None = None
    freedom: float | None = None
    family: int = 1
    effect: float | None = None
    """The standardised effect: the mean in standard deviations of one of the differences that `error` was made from, of
    pairs within a scene or of scenes. None if they do not differ.
    """
    p: float | None = None
    """The two-sided p-value of a difference of 0, by the t of `interval`: below 5 % where that lies on one side."""


def paired_difference(differences: np.ndarray, family: int = 1) -> PairedDifference:
    """Compare by independent differences [units]; raises `ValueError` if there is none or one is not finite.

    `family` is the number of comparisons that are looked at together.
    """
    values = np.asarray(differences, dtype=np.float64)
    if values.size == 0 or not np.isfinite(values).all():
        raise ValueError(f"differences must be finite and not empty, got {values}")
    return difference_of(nested.scenes_like_these(values[:, None]), values.size, family)


def on_these_scenes(table: dict[str, np.ndarray], family: int = 1) -> PairedDifference:
    """Map scene → differences [seeds], NaN where a seed has none, to the mean over scenes of the means over seeds.

    The scenes are those that are asked about, so that the error comes from seeds alone. Raises `ValueError` if there is
    no difference at all.
    """
    values = _rows(table)
    return difference_of(nested.on_these_scenes(values), len(values), family)


def on_one_scene(differences: np.ndarray, family: int = 1) -> PairedDifference:
    """Compare by the differences [seeds] of one scene, NaN where a seed has none: Student's t on them.

    That is what Satterthwaite's freedom comes to for the pairs of one scene, whose variance no other scene lends.
    Raises `ValueError` if there is no difference.
    """
    return paired_difference(differences[np.isfinite(differences)], family)


def scenes_like_these(table: dict[str, np.ndarray], family: int = 1) -> PairedDifference:
    """Compare as `on_these_scenes`, but for scenes that were not tried: Student's t over the means of the scenes.

    A single scene gives no interval.
    """
    values = _rows(table)
    return difference_of(nested.scenes_like_these(values), len(values), family)


def _rows(table: dict[str, np.ndarray]) -> np.ndarray:
    """Return [scenes that have a difference, seeds]."""
    there = [values for values in table.values() if np.isfinite(values).any()]
    if not there:
        raise ValueError("no scene has a difference")
    rows = np.full((len(there), max(map(len, there))), np.nan)
    for row, values in zip(rows, there, strict=True):
        row[: len(values)] = values
    return rows


def difference_of(estimates: nested.Estimated, units: int, family: int = 1) -> PairedDifference:
    """Return the difference of one table of `units` that were estimated from."""
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
    """Round down to a tenth, so that computations are shared; all are equal above a limit, at which t is normal."""
    tenths = np.floor(10 * np.minimum(freedom, MOST_FREEDOM) + 1e-6) / 10
    return np.asarray(np.maximum(tenths, np.minimum(freedom, LEAST_FREEDOM)))


def half_widths(estimates: nested.Estimated, family: int = 1) -> np.ndarray:
    """Return half the widths of the intervals of many estimates, as they are printed for one; NaN for no interval."""
    values, places = np.unique(rounded_down(estimates.freedom), return_inverse=True)
    factors = np.array([critical(float(value), family) if value >= LEAST_FREEDOM else np.nan for value in values])
    return np.asarray(factors[places.reshape(estimates.freedom.shape)] * estimates.error)


def p_values(estimates: nested.Estimated) -> np.ndarray:
    """Return the two-sided p-values of many estimates, as they are printed for one; NaN where there is no interval."""
    known = np.where(estimates.freedom >= LEAST_FREEDOM, rounded_down(estimates.freedom), np.nan)
    return p_value(estimates.mean, estimates.error, known)


def p_value(mean: np.ndarray | float, error: np.ndarray | float, freedom: np.ndarray | float) -> np.ndarray:
    """Return the chance of an estimate as far from 0 as `mean` or farther, on both sides, if 0 is the truth."""
    with np.errstate(invalid="ignore", divide="ignore"):
        score = np.where(np.asarray(mean) == 0.0, 0.0, np.abs(mean) / np.asarray(error))
    # of an infinite score stdtr is NaN
    return np.asarray(np.where(np.isinf(score), 0.0, 2.0 * stdtr(freedom, -score)))


def critical(freedom: float, family: int = 1) -> float:
    """Return the half-width, in standard errors, of one of `family` two-sided intervals that hold together in 95 %."""
    return _quantile(1.0 - (1.0 - CONFIDENCE) / 2 / family, freedom)


@lru_cache(maxsize=4096)
def _quantile(share: float, freedom: float) -> float:
    return float(stdtrit(freedom, share))


def sign_test(ahead: int, behind: int) -> float:
    """Return the two-sided p-value of the exact sign test: the chance of so unequal counts, or more, of fair coins."""
    tosses = ahead + behind
    return min(1.0, 2 * sum(math.comb(tosses, heads) for heads in range(min(ahead, behind) + 1)) / (1 << tosses))


def shift_found(threshold: float, freedom: float) -> float:
    """Return the true mean, in standard errors, that is found in 80 % of repetitions: by the noncentral t distribution.

    A mean is found if it lies beyond `threshold` of its own estimated standard errors, which have `freedom` degrees of
    freedom. The estimate's own uncertainty counts: with few degrees of freedom this is well beyond the sum of two
    quantiles of t.
    """
    # rounded to all digits that count, so that a table and the same one shifted share a cache entry
    return _shift_found(float(f"{threshold:.7g}"), float(f"{freedom:.7g}"))


@lru_cache(maxsize=32768)
def _shift_found(threshold: float, freedom: float) -> float:
    high = threshold + 2.0
    while share_found(high, threshold, freedom) < POWER:
        high *= 2.0
    return float(brentq(lambda shift: share_found(shift, threshold, freedom) - POWER, 0.0, high, xtol=1e-9 * high))


def share_found(shift: float, threshold: float, freedom: float) -> float:
    """Return the share of repetitions, with a true mean of `shift` standard errors, that find it: the noncentral t
    distribution's upper tail. Given the mean, its estimated error must be small enough for 0 to lie outside.
    """
    return float(WEIGHTS @ _error_below((NORMAL + shift) / threshold, freedom))


def _error_below(bound: np.ndarray, freedom: float) -> np.ndarray:
    """Return the probability that the estimated standard error is below `bound` true ones: χ."""
    return np.asarray(gammainc(freedom / 2, freedom / 2 * np.maximum(bound, 0.0) ** 2))


def verdict(result: PairedDifference, smallest_of_interest: float) -> Verdict:
    """Return sign and size as the simultaneous interval allows (`harness.records.verdict.verdict_of`)."""
    return verdict_of(result.simultaneous, smallest_of_interest)


def estimate(result: PairedDifference, smallest_of_interest: float, settled: bool = True) -> Estimate:
    """Return the record of an estimate, both answers open and without a p-value unless `settled`."""
    called, p = (verdict(result, smallest_of_interest), result.p) if settled else (OPEN, None)
    together = None if p is None else min(1.0, p * result.family)
    least = result.smallest_detectable
    return Estimate(result.interval, result.simultaneous, result.family, called, least, result.effect, p, together)
