"""Estimates that one bad value does not decide, and outliers: pure functions on arrays.

One bad cell of three does not move the median over the seeds of a scene. Over scenes the estimate is that of Hodges and
Lehmann (1963), the median of the means of all pairs of scenes, with the exact interval of Wilcoxon's signed ranks,
which assumes only symmetry and keeps its level for six scenes or more. At eight scenes the coverage of 25 % trimmed
means with Yuen's error falls to 93 %, and one bad scene invalidates Student's t over medians
(`harness/studies/evidence/calibration.py`).
"""

from functools import lru_cache

import numpy as np

from harness.verdicts.estimates.nested import medians

LEVEL = 0.05
OUTLIER_DEVIATIONS = 5.0
"""The distance from the median of the paired differences, in robust standard deviations, at which a cell is named."""
FEWEST_FOR_OUTLIERS = 6
"""The minimum number of paired differences for finding outliers by their median absolute deviation."""
TO_SD = 1.4826
"""The standard deviation of normal values in units of their median absolute deviation."""


def robust_over_scenes(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the robust mean over scenes of `values` [..., scenes, seeds], and the ends of its 95 % interval, [...],
    NaN for fewer than six scenes. Raises `ValueError` if tables lack different scenes.
    """
    of_scenes = medians(values)
    there = np.isfinite(of_scenes)
    shared = there.reshape(-1, there.shape[-1])
    if (shared != shared[0]).any():
        raise ValueError("tables that lack different scenes cannot be estimated together")
    return hodges_lehmann(of_scenes[..., shared[0]])


def hodges_lehmann(units: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the Hodges–Lehmann estimate of `units` [..., n] and the ends of its exact 95 % interval, [...]. The ends
    are NaN below six units, as chance puts all of them on one side in over 5 %. Raises `ValueError` without a unit.
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
    """Return the number of ordered means outside the interval at each end."""
    ways = np.ones(1)
    for rank in range(1, count + 1):  # the distribution of Wilcoxon's sum: each rank counts or does not
        more = np.zeros(ways.size + rank)
        more[: ways.size] += ways / 2
        more[rank:] += ways / 2
        ways = more
    return int((np.cumsum(ways) <= LEVEL / 2).sum())


def outliers(table: dict[str, np.ndarray], margin: float) -> list[tuple[str, int]]:
    """Return scene and index of the seed of each outlying difference of `table`, scene → [seeds].

    An outlier lies more than five robust standard deviations (`TO_SD` times the median absolute deviation of all
    differences), and more than `margin`, from the median of all; and from that of its scene, if that has three seeds.
    """
    known = np.concatenate([values[np.isfinite(values)] for values in table.values()] or [np.empty(0)])
    if known.size < FEWEST_FOR_OUTLIERS:
        return []
    centre = float(np.median(known))
    limit = max(OUTLIER_DEVIATIONS * TO_SD * float(np.median(np.abs(known - centre))), margin)
    places = []
    for scene, row in table.items():
        mates = row[np.isfinite(row)]
        own = float(np.median(mates)) if mates.size >= 3 else centre
        off = np.minimum(np.abs(row - centre), np.abs(row - own)) > limit
        places += [(scene, int(seed)) for seed in np.flatnonzero(off)]
    return places
