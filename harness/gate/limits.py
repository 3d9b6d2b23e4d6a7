"""What was measured of images → limits, and what they find: pure functions.

A limit is a prediction interval: what new renders of the same code give lies outside with a probability of `LEVEL`,
where spreads are normal, their own uncertainty included (Student). How far that holds in the outer tail is not known
from a few measurements; nothing that was measured is ever left out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from harness.gate.catalog import Gate
from harness.statistics import POWER, shift_found

LEVEL = 0.01 / 80
EULER = 0.5772156649


@dataclass(frozen=True)
class Limit:
    """Of one gate: at least `low`, at most `high`."""

    low: float | None
    high: float | None
    centre: float | None = None
    spread: float | None = None
    """Standard deviation of one measurement, in the gate's unit; of the logarithm for `largest`."""
    measured: int = 0
    """Measurements that it is made of."""
    detects: float | None = None
    """The change of the figure that is found in 80 % of repetitions of renewal and gate, if the true spread is
    `spread`; for `largest` the deviation itself."""


NONE_DIFFERS = Limit(None, 0.0, detects=1.0)


def limit_from(gate: Gate, values: Sequence[float]) -> Limit:
    """From independent measurements that are not those of the gate.

    Raises `ValueError` for fewer than three, and for one that is not finite.
    """
    sample = np.asarray(values, dtype=np.float64)
    if sample.size < 3 or not np.isfinite(sample).all():
        raise ValueError(f"{gate.name}: three or more finite measurements are needed, got {values}")
    if gate.rule == "largest":
        if sample.min() <= 0:
            raise ValueError(f"{gate.name}: measurements must be above 0, got {values}")
        sample = np.log(sample)
    centre, spread, many = float(sample.mean()), float(sample.std(ddof=1)), int(sample.size)
    if gate.rule == "largest":
        return _largest(centre, spread, many, gate.new)
    error = spread * math.sqrt(1 / gate.new + 1 / many)
    beyond = _quantile(1 - LEVEL / 2, many - 1)
    wide = beyond * error
    return Limit(centre - wide, centre + wide, centre, spread, many, shift_found(beyond, many - 1) * error)


def _largest(centre: float, spread: float, many: int, new: int) -> Limit:
    """Fréchet by moments: the logarithm of the largest of very many pixels is taken to be Gumbel's.

    Its scale is taken at the upper end of its 99 % interval, as the limit is far beyond what was measured.
    """
    scale = spread * math.sqrt(6) / math.pi
    upper = scale * (1 + float(norm.ppf(0.99)) * 1.05 / math.sqrt(many))
    high = centre - EULER * scale + upper * (math.log(new) - math.log(-math.log1p(-LEVEL)))
    # a deviation is on top of noise of one standard deviation
    return Limit(None, math.exp(high), math.exp(centre), spread, many, math.exp(high) + float(norm.ppf(POWER)))


@cache
def _quantile(share: float, freedom: int) -> float:
    """Student's."""
    return float(student.ppf(share, freedom))


def figure_of(gate: Gate, values: Sequence[float | None]) -> float | None:
    """The gate's figure from its new measurements; None where one is missing or not finite: that is never left out."""
    sample = [value for value in values if value is not None and math.isfinite(value)]
    if len(sample) != len(values) or not sample:
        return None
    return float(np.max(sample) if gate.rule == "largest" else np.mean(sample))


def excess_of(figure: float, limit: Limit) -> float:
    """By how much the figure is beyond its limit; 0 or less where it is within."""
    beyond = [limit.low - figure] if limit.low is not None else []
    beyond += [figure - limit.high] if limit.high is not None else []
    return max(beyond)
