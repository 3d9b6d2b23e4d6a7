"""Finds where a series of measurements changed its level: circular binary segmentation (Olshen et al. 2004) on ranks.

The segment that differs most from the rest of the series, at its end or within it, is cut out if chance would rarely
make it differ so much, and every piece is searched again. Timings have heavy tails, and a figure that is always 0 has
no spread. So ranks are compared, and chance is measured by random orders of the same ranks. A single outlying run is
not a change; a change has at least `LEAST` measurements on each side.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.stats import norm, rankdata

CHANCE = 0.01
"""The probability that a change is reported in a series without one."""
LEAST = 3
"""The minimum number of measurements between two changes, before the first and after the last one."""
ORDERS = 1999
FEWEST = 12
"""The minimum number of measurements: with fewer, even the clearest change has a probability above `CHANCE`."""
MOST = 300
"""The number of last measurements that are searched: the time grows with its square."""


@dataclass(frozen=True)
class ChangePoint:
    """A change of level between two neighbouring measurements."""

    index: int
    """The index of the first measurement after it."""
    before: float
    """The median since the previous change, or the beginning."""
    after: float
    chance: float
    """The probability of a change this clear in a series without one."""


def change_points(values: np.ndarray) -> list[ChangePoint]:
    """Return the changes of a series [n] of finite numbers in their order; none if it is shorter than `FEWEST`."""
    skipped = max(0, len(values) - MOST)
    splits = sorted(_splits(values[skipped:], skipped))
    if not splits:
        return []
    ends = [skipped, *(index for index, _ in splits), len(values)]
    for place in range(1, len(ends) - 1):
        ends[place] = _refine(values, *ends[place - 1 : place + 2])
    levels = [float(np.median(values[start:stop])) for start, stop in pairwise(ends)]
    return [
        ChangePoint(index, before, after, chance)
        for index, (before, after), (_, chance) in zip(ends[1:-1], pairwise(levels), splits, strict=True)
    ]


def _refine(values: np.ndarray, start: int, index: int, stop: int) -> int:
    """Return the index near `index` at which both sides are nearest to their medians: ranks blur it by one or two."""

    def spread(place: int) -> float:
        sides = values[start:place], values[place:stop]
        return float(sum(np.abs(side - np.median(side)).sum() for side in sides))

    near = range(max(start + 1, index - LEAST + 1), min(stop, index + LEAST))
    return min(near, key=lambda place: (spread(place), abs(place - index)))


def _splits(values: np.ndarray, start: int) -> Iterator[tuple[int, float]]:
    """Yield index and chance of each change in a piece that begins at `start`."""
    count = len(values)
    if count < FEWEST:
        return
    ranks = norm.ppf((rankdata(values) - 0.375) / (count + 0.25))  # normal scores, Blom 1958
    scores = ranks - ranks.mean()
    clearest, begin, end = max((float(clear[0].max()), begin, int(ends[clear[0].argmax()]))
                               for begin, ends, clear in _segments(scores[None]))  # fmt: skip
    as_clear = _by_chance(np.sort(scores).tobytes()) >= clearest - 1e-12
    chance = float((1 + np.count_nonzero(as_clear)) / (ORDERS + 1))
    if chance > CHANCE:
        return
    places = [place for place in (begin, end) if 0 < place < count]
    yield from ((start + place, chance) for place in places)
    for first, last in pairwise([0, *places, count]):
        yield from _splits(values[first:last], start + first)


def _segments(scores: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield for series [k, n] of mean 0 each index where a segment can begin, the indices [m] where it can end, and the
    distance of its mean from that of the rest in standard errors [k, m].
    """
    count = scores.shape[1]
    sums = np.concatenate([np.zeros((len(scores), 1)), np.cumsum(scores, axis=1)], axis=1)
    for begin in (0, *range(LEAST, count - LEAST + 1)):
        ends = np.arange(begin + LEAST, count + 1)
        inside = ends - begin
        ends = ends[(ends == count) | (ends <= count - LEAST) & (inside <= count - LEAST)]
        ends = ends[(begin > 0) | (ends < count)]
        inside = ends - begin
        yield begin, ends, np.abs(sums[:, ends] - sums[:, [begin]]) * np.sqrt(count / (inside * (count - inside)))


@cache
def _by_chance(sorted_scores: bytes) -> np.ndarray:
    """Return the clearest segment's distance in each of `ORDERS` random orders of the scores."""
    scores = np.tile(np.frombuffer(sorted_scores), (ORDERS, 1))
    orders = np.random.default_rng(0).permuted(scores, axis=1)
    clearest: np.ndarray = np.max([clear.max(axis=1) for _, _, clear in _segments(orders)], axis=0)
    return clearest
