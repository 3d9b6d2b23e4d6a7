"""Paired differences, their intervals and their verdicts: pure functions on arrays.

The units are scenes and seeds, never pixels or views. Over several scenes the standard error is that of a crossed
bootstrap (Owen 2007, The pigeonhole bootstrap): scenes and seeds are drawn with replacement independently of each
other, and every drawn pair counts. Its interval is Student's, with the scenes as units: the percentiles of a few
hundred distinct means do not reach the levels that many comparisons at once ask for.
"""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from scipy.stats import t as student

Verdict = Literal["better", "worse", "equivalent", "inconclusive"]

CONFIDENCE = 0.95
POWER = 0.80
RESAMPLES = 4000


@dataclass(frozen=True)
class PairedDifference:
    """A mean of paired differences, its two-sided 95 % interval, and what such a sample can detect."""

    mean: float
    interval: tuple[float, float] | None
    """None with fewer than two units: one difference has no spread."""
    smallest_detectable: float | None
    """The true difference that such a sample, with this spread, would tell from 0 in 80 % of repetitions."""
    units: int
    simultaneous: tuple[float, float] | None = None
    """The interval that a verdict is taken from: of all the family's intervals of this kind, every one holds the truth
    in 95 % of repetitions (Bonferroni). Equal to `interval` for a family of one."""


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
    return _difference(mean, crossed_error(table), len(table), family)


def crossed_error(table: np.ndarray) -> float:
    """Standard error of the mean of `table` [scenes, seeds] by crossed bootstrap, corrected for few scenes.

    A little too large on purpose: what differs in one cell alone counts up to three times. Raises `ValueError` with
    fewer than two scenes or for a scene without any difference.
    """
    scenes, seeds = table.shape
    there = np.isfinite(table)
    if scenes < 2 or not there.any(axis=1).all():
        raise ValueError(f"a crossed bootstrap needs two scenes or more, each with a difference; got {table}")
    rows, columns = _counts(scenes, seeds)
    weights = np.einsum("bi,bj,ij->b", rows, columns, there.astype(np.float64))
    sums = np.einsum("bi,bj,ij->b", rows, columns, np.where(there, table, 0.0))
    means = sums[weights > 0] / weights[weights > 0]
    return float(means.std() * (scenes / (scenes - 1)) ** 0.5)


@cache
def _counts(scenes: int, seeds: int) -> tuple[np.ndarray, np.ndarray]:
    """How often each scene [resamples, scenes] and each seed [resamples, seeds] is drawn."""
    generator = np.random.default_rng(20260107)
    return (
        generator.multinomial(scenes, np.full(scenes, 1.0 / scenes), RESAMPLES).astype(np.float64),
        generator.multinomial(seeds, np.full(seeds, 1.0 / seeds), RESAMPLES).astype(np.float64),
    )


def _difference(mean: float, error: float | None, units: int, family: int) -> PairedDifference:
    if error is None:
        return PairedDifference(mean, None, None, units, None)
    alone, together = (critical(units - 1, many) * error for many in (1, family))
    found = together + float(student.ppf(POWER, units - 1)) * error
    return PairedDifference(mean, (mean - alone, mean + alone), found, units, (mean - together, mean + together))


@cache
def critical(freedom: int, family: int = 1) -> float:
    """Half-width, in standard errors, of one of `family` two-sided intervals that hold together in 95 %."""
    return float(student.ppf(1.0 - (1.0 - CONFIDENCE) / 2 / family, freedom))


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
