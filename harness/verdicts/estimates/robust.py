"""Estimates that one bad value neither makes nor hides, and the values that lie off: pure functions on arrays.

Medians over the seeds of a scene are not moved by one bad cell of three. Over scenes the estimate is that of Hodges and
Lehmann (1963), the median of the means of all pairs of scenes, and its interval is the exact one of Wilcoxon's signed
ranks: it asks for symmetry alone, neither for normal values nor for equal spreads, and holds its level for any number
of scenes from six on, where 25 % trimmed means with Yuen's error fall to 93 % at eight scenes, and Student's t over
medians is lost with one bad scene. `harness/studies/evidence/calibration.py` shows the coverage with and without a
collapsed cell.
"""

from functools import lru_cache

import numpy as np

from harness.verdicts.estimates.nested import scene_medians

LEVEL = 0.05
OUTLIER_DEVIATIONS = 5.0
"""The robust standard deviations from the median of a comparison's paired differences at which a cell is named."""
FEWEST_FOR_OUTLIERS = 6
"""The fewest paired differences whose median absolute deviation can tell an outlier."""
TO_SD = 1.4826
"""The standard deviation of normal values in units of their median absolute deviation."""


def robust_over_scenes(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the robust mean over scenes of `values` [..., scenes, seeds], and the ends of its 95 % interval, [...].

    The ends are NaN for fewer than six scenes. All tables must lack the same scenes, if any.
    """
    medians = scene_medians(values)
    there = np.isfinite(medians)
    shared = there.reshape(-1, there.shape[-1])
    if (shared != shared[0]).any():
        raise ValueError("tables that lack different scenes cannot be estimated together")
    return hodges_lehmann(medians[..., shared[0]])


def hodges_lehmann(units: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the Hodges–Lehmann estimate of `units` [..., n] and the ends of its exact 95 % interval, [...].

    The ends are NaN below six units: even if all lie on one side, chance alone explains that in more than 5 %. Raises
    `ValueError` for no unit.
    """
    count = units.shape[-1]
    if not count:
        raise ValueError("no unit to estimate from")
    first, second = np.triu_indices(count)
    means = np.sort((units[..., first] + units[..., second]) / 2, axis=-1)
    cut = _cut(count)
    none = np.full(units.shape[:-1], np.nan)
    first_end, last_end = (none, none) if not cut else (means[..., cut - 1], means[..., -cut])
    low, high = (means.shape[-1] - 1) // 2, means.shape[-1] // 2
    middle = (means[..., low] + means[..., high]) / 2
    return np.asarray(middle), np.asarray(first_end), np.asarray(last_end)


@lru_cache(maxsize=256)
def _cut(count: int) -> int:
    """Return how many of the ordered means lie outside the interval at each end."""
    ways = np.ones(1)
    for rank in range(1, count + 1):  # the distribution of Wilcoxon's sum: each rank counts or does not
        more = np.zeros(ways.size + rank)
        more[: ways.size] += ways / 2
        more[rank:] += ways / 2
        ways = more
    return int((np.cumsum(ways) <= LEVEL / 2).sum())


def outliers(table: dict[str, np.ndarray], least: float) -> list[tuple[str, int]]:
    """Return scene and place of the seed of each difference that lies off all others of `table`, scene → [seeds].

    It lies more than five robust standard deviations (1.4826 times the median absolute deviation of all paired
    differences of the comparison), and more than `least`, from the median of all, and from that of its own scene if
    that has three seeds: where all seeds agree that a scene is another one, no cell is off.
    """
    known = np.concatenate([values[np.isfinite(values)] for values in table.values()] or [np.empty(0)])
    if known.size < FEWEST_FOR_OUTLIERS:
        return []
    centre = float(np.median(known))
    limit = max(OUTLIER_DEVIATIONS * TO_SD * float(np.median(np.abs(known - centre))), least)
    found = []
    for scene, row in table.items():
        mates = row[np.isfinite(row)]
        own = float(np.median(mates)) if mates.size >= 3 else centre
        off = np.minimum(np.abs(row - centre), np.abs(row - own)) > limit
        found += [(scene, int(seed)) for seed in np.flatnonzero(off)]
    return found
