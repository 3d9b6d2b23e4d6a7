"""Many pairs judged together: adjusted p-values by sign flips, and letters that display them. Pure functions.

Westfall and Young's step-down max-T procedure (1993) bounds the probability of any wrong sign in the family. Under the
null hypothesis a scene's difference is as likely as its negative, so that all signs of the scenes are flipped together
for all pairs, which keeps their dependence. Letters are Piepho's compact letter display (2004).
"""

from collections.abc import Iterable, Sequence

import numpy as np

MOST_FLIPS = 4096
"""The number of flips up to which all are tried; of more, a fixed random sample is taken."""
LEAST_UNITS = 6
"""The minimum number of scenes: with five, no p-value is below 2 / 2⁵ = 6 %."""
CHUNK = 64
MOST_LETTERS = 200


def step_down_max_t(differences: np.ndarray) -> np.ndarray:
    """Return the adjusted two-sided p-value of each row of differences [pairs, units], NaN for a missing one."""
    there = np.isfinite(differences)
    values = np.where(there, differences, 0.0)
    count, squares = there.sum(axis=1), (values**2).sum(axis=1)
    flips = _flips(values.shape[1])

    def statistic(sums: np.ndarray) -> np.ndarray:
        """Return Student's |t| of sums [flips, pairs]; 0 for pairs that have fewer than two units or no difference."""
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.minimum(sums**2 / (count * squares), 1.0)
            score = np.sqrt(share * (count - 1) / np.where(share < 1.0 - 1e-12, 1.0 - share, 0.0))
        return np.where((count > 1) & (squares > 0.0), score, 0.0)

    observed = statistic(values.sum(axis=1)[None])[0]
    order = np.argsort(-observed, kind="stable")
    reached = observed[order] * (1.0 - 1e-9)
    exceeded = np.zeros(len(values))
    for first in range(0, len(flips), CHUNK):
        scores = statistic(flips[first : first + CHUNK] @ values.T)[:, order]
        largest = np.maximum.accumulate(scores[:, ::-1], axis=1)[:, ::-1]
        exceeded += (largest >= reached).sum(axis=0)
    adjusted = np.empty(len(values))
    adjusted[order] = np.maximum.accumulate(exceeded / len(flips))
    return adjusted


def _flips(units: int) -> np.ndarray:
    """Return signs [flips, units], the first row unchanged; of a row and its negative, which give one |t|, only one."""
    if 2 ** (units - 1) <= MOST_FLIPS:
        numbers = np.arange(2 ** (units - 1))
        return 1.0 - 2.0 * ((numbers[:, None] >> np.arange(units)) & 1)
    random = np.random.default_rng(0).integers(0, 2, (MOST_FLIPS, units))
    random[0] = 0
    return 1.0 - 2.0 * random


def letters(count: int, distinguished: Iterable[tuple[int, int]]) -> list[list[int]]:
    """Return the letters of `count` methods, as numbers from 1: two share one exactly if they are not distinguished.
    Without any letter if more than `MOST_LETTERS` would be needed.
    """
    columns = [(1 << count) - 1]
    for a, b in distinguished:
        both = (1 << a) | (1 << b)
        split = [column for column in columns if column & both == both]
        columns = [column for column in columns if column & both != both]
        for part in (part for column in split for part in (column & ~(1 << a), column & ~(1 << b))):
            if not any(part & other == part for other in columns):
                columns = [other for other in columns if other & part != other]
                columns.append(part)
        if len(columns) > MOST_LETTERS:
            return [[] for _ in range(count)]
    columns.sort(key=lambda column: [k for k in range(count) if column >> k & 1])
    return [[number for number, column in enumerate(columns, 1) if column >> k & 1] for k in range(count)]


def written(numbers: Sequence[int]) -> str:
    """Return letters by their numbers: a, b, …, z, aa, ab, …"""

    def letter(number: int) -> str:
        high, low = divmod(number - 1, 26)
        return (letter(high) if high else "") + "abcdefghijklmnopqrstuvwxyz"[low]

    return "".join(map(letter, numbers)) if max(numbers, default=0) <= 26 else " ".join(map(letter, numbers))
