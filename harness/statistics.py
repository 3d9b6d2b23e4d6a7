"""Paired differences, their intervals and their verdicts: pure functions on arrays.

The units are scenes and seeds, never pixels or views. Over several scenes the standard error is that of a crossed
bootstrap (Owen 2007, The pigeonhole bootstrap): scenes and seeds are drawn with replacement independently of each
other, and every drawn pair counts. Its interval is Student's, with the scenes as units (fewer where seeds matter): the
percentiles of a few hundred distinct means do not reach the levels that many comparisons at once ask for.
"""

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Literal

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammainc
from scipy.stats import t as student

Verdict = Literal["better", "worse", "equivalent", "inconclusive"]

CONFIDENCE = 0.95
POWER = 0.80
RESAMPLES = 4000

NORMAL = np.linspace(-8.0, 8.0, 801)
WEIGHTS = np.exp(-(NORMAL**2) / 2) / np.exp(-(NORMAL**2) / 2).sum()
"""A standard normal variable on a grid: the trapezoidal rule is as good as exact where the integrand is smooth."""


@dataclass(frozen=True)
class PairedDifference:
    """A mean of paired differences, its two-sided 95 % interval, and what such a sample can detect."""

    mean: float
    interval: tuple[float, float] | None
    """None with fewer than two units: one difference has no spread."""
    smallest_detectable: float | None
    """The true difference that samples of this size tell from 0 in 80 % of repetitions, if the true spread is the one
    measured here."""
    units: int
    simultaneous: tuple[float, float] | None = None
    """The interval that a verdict is taken from: of all the family's intervals of this kind, every one holds the truth
    in 95 % of repetitions (Bonferroni). Equal to `interval` for a family of one."""
    error: float | None = None
    """Standard error of the mean."""
    freedom: float | None = None
    """Degrees of freedom of `error`."""
    family: int = 1


def paired_difference(differences: np.ndarray, family: int = 1) -> PairedDifference:
    """From independent differences [units]; raises `ValueError` where there is none or one is not finite.

    `family` is the number of comparisons that are looked at together.
    """
    values = np.asarray(differences, dtype=np.float64)
    if values.size == 0 or not np.isfinite(values).all():
        raise ValueError(f"differences must be finite and not empty, got {values}")
    error = float(values.std(ddof=1)) / values.size**0.5 if values.size > 1 else None
    return _difference(float(values.mean()), error, int(values.size), family)


def over_scenes(differences: dict[str, np.ndarray], family: int = 1) -> PairedDifference:
    """Scene → differences [seeds], NaN where a seed has none: the mean over scenes of the means over seeds.

    Scenes are the units, as a claim is about scenes not seen yet. With a single scene its seeds are.
    """
    if len(differences) == 1:
        only = next(iter(differences.values()))
        return paired_difference(only[np.isfinite(only)], family)
    table = np.array(list(differences.values()), dtype=np.float64)
    mean = float(np.nanmean(table, axis=1).mean())
    error, freedom = crossed(table)
    return _difference(mean, error, len(table), family, freedom)


def crossed_error(table: np.ndarray) -> float:
    """Standard error of the mean of `table` [scenes, seeds] by crossed bootstrap; see `crossed`."""
    return crossed(table)[0]


def crossed(table: np.ndarray) -> tuple[float, float]:
    """Standard error of the mean of `table` [scenes, seeds] by crossed bootstrap, and its degrees of freedom.

    A little too large on purpose: what differs in one cell alone counts up to three times. Its three parts, of scenes
    drawn alone, of seeds drawn alone, and the rest, are each corrected for how few were drawn from; the degrees of
    freedom are Satterthwaite's, and no more than the scenes have: where what differs from seed to seed in all scenes
    alike outweighs the rest, many scenes do not make up for few seeds. Raises `ValueError` with fewer than two scenes
    or for a scene without any difference.
    """
    scenes, seeds = table.shape
    there = np.isfinite(table)
    if scenes < 2 or not there.any(axis=1).all():
        raise ValueError(f"a crossed bootstrap needs two scenes or more, each with a difference; got {table}")
    rows, columns = _counts(scenes, seeds)
    values, weights = np.where(there, table, 0.0), there.astype(np.float64)
    by_scene = _variance(rows, np.ones_like(columns), values, weights) * scenes / (scenes - 1)
    by_seed = _variance(np.ones_like(rows), columns, values, weights)
    rest = _variance(rows, columns, values, weights) * scenes / (scenes - 1) - by_scene
    rest = max(rest - by_seed * scenes / (scenes - 1), 0.0)
    if seeds == 1:
        return by_scene**0.5, scenes - 1.0
    by_seed *= seeds / (seeds - 1)
    total = by_scene + by_seed + rest
    if total == 0:
        return 0.0, scenes - 1.0
    spread = by_scene**2 / (scenes - 1) + by_seed**2 / (seeds - 1) + rest**2 / ((scenes - 1) * (seeds - 1))
    return total**0.5, min(total**2 / spread, scenes - 1.0)


def _variance(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, weights: np.ndarray) -> float:
    """Of the means of resampled tables; one that drew nothing that is there is left out."""
    sums = np.einsum("bj,bj->b", rows @ values, columns)
    if weights.all():
        return float(sums.var()) / weights.size**2
    counts = np.einsum("bj,bj->b", rows @ weights, columns)
    return float((sums[counts > 0] / counts[counts > 0]).var())


@cache
def _counts(scenes: int, seeds: int) -> tuple[np.ndarray, np.ndarray]:
    """How often each scene [resamples, scenes] and each seed [resamples, seeds] is drawn."""
    generator = np.random.default_rng(20260107)
    return (
        generator.multinomial(scenes, np.full(scenes, 1.0 / scenes), RESAMPLES).astype(np.float64),
        generator.multinomial(seeds, np.full(seeds, 1.0 / seeds), RESAMPLES).astype(np.float64),
    )


def _difference(
    mean: float, error: float | None, units: int, family: int, freedom: float | None = None
) -> PairedDifference:
    """`freedom` is one less than `units` where it is not given."""
    if error is None:
        return PairedDifference(mean, None, None, units, None)
    freedom = units - 1.0 if freedom is None else freedom
    alone, together = (critical(freedom, many) * error for many in (1, family))
    found = shift_found(critical(freedom, family), freedom) * error
    interval, simultaneous = ((mean - half, mean + half) for half in (alone, together))
    return PairedDifference(mean, interval, found, units, simultaneous, error, freedom, family)


def critical(freedom: float, family: int = 1) -> float:
    """Half-width, in standard errors, of one of `family` two-sided intervals that hold together in 95 %."""
    return _quantile(1.0 - (1.0 - CONFIDENCE) / 2 / family, freedom)


@lru_cache(maxsize=4096)
def _quantile(share: float, freedom: float) -> float:
    return float(student.ppf(share, freedom))


def detectable(result: PairedDifference, smallest_of_interest: float) -> float | None:
    """The true difference of which `verdict` would say better or worse in 80 % of repetitions, not only tell from 0.

    Larger than `smallest_detectable` where that is so small that the interval may lie within the effects of no
    interest.
    """
    if result.error is None or result.freedom is None:
        return None
    if result.error == 0:
        return smallest_of_interest
    threshold = critical(result.freedom, result.family)
    return shift_found(threshold, result.freedom, smallest_of_interest / result.error) * result.error


def shift_found(threshold: float, freedom: float, of_interest: float = 0.0) -> float:
    """The true mean, in standard errors, that is found in 80 % of repetitions: by the noncentral t distribution.

    Found is a mean beyond `threshold` of its own estimated standard errors, which have `freedom` degrees of freedom,
    and whose interval of ± as many reaches beyond `of_interest`, in true standard errors, too. The estimate's own
    uncertainty counts: with few degrees of freedom this is well beyond the sum of two quantiles of t.
    """
    # equal to all digits that matter, so that a table and the same one shifted find each other
    return _shift_found(*(float(f"{value:.7g}") for value in (threshold, freedom, of_interest)))


@lru_cache(maxsize=32768)
def _shift_found(threshold: float, freedom: float, of_interest: float) -> float:
    high = threshold + of_interest + 2.0
    while share_found(high, threshold, freedom, of_interest) < POWER:
        high *= 2.0
    return float(brentq(lambda shift: share_found(shift, threshold, freedom, of_interest) - POWER, 0.0, high))


def share_found(shift: float, threshold: float, freedom: float, of_interest: float = 0.0) -> float:
    """Of repetitions, with a true mean of `shift` standard errors; see `shift_found`.

    Without `of_interest` it is the noncentral t distribution's upper tail. Given the mean, its estimated error must be
    small enough for 0 to lie outside, and large enough for the smallest effect of interest to lie inside.
    """
    mean = NORMAL + shift
    most, least = mean / threshold, (of_interest - mean) / threshold
    return float(WEIGHTS @ np.maximum(_error_below(most, freedom) - _error_below(least, freedom), 0.0))


def _error_below(bound: np.ndarray, freedom: float) -> np.ndarray:
    """Probability that the estimated standard error is below `bound` true ones: χ."""
    return np.asarray(gammainc(freedom / 2, freedom / 2 * np.maximum(bound, 0.0) ** 2))


def verdict(result: PairedDifference, smallest_of_interest: float, higher_is_better: bool) -> Verdict:
    """What the simultaneous interval allows to say.

    equivalent    the whole interval lies within ± the smallest effect of interest
    better/worse  the interval does not hold 0
    inconclusive  anything else, and whatever has no interval
    """
    if result.simultaneous is None:
        return "inconclusive"
    low, high = result.simultaneous
    if -smallest_of_interest < low and high < smallest_of_interest:
        return "equivalent"
    if low > 0:
        return "better" if higher_is_better else "worse"
    if high < 0:
        return "worse" if higher_is_better else "better"
    return "inconclusive"
