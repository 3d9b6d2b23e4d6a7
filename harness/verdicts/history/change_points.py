"""When a series of measurements changed its level: circular binary segmentation (Olshen et al. 2004) on ranks.

The stretch that differs most from the rest of the series, at its end or within it, is cut out if it would seldom differ
as much by chance, and every piece is looked at again. Timings have heavy tails, and a figure that is always 0 has no
spread at all: so ranks are compared, and the chance is counted among random orders of the same ranks. A single run that
is far off is no change; `LEAST` on each side are.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.stats import norm, rankdata

CHANCE = 0.01
"""The probability with which a series without any change is said to have one."""
LEAST = 3
"""The fewest measurements between two changes, and before the first and after the last one."""
ORDERS = 1999
FEWEST = 12
"""The measurements below which even the clearest change happens by chance more often than `CHANCE`."""
MOST = 300
"""The measurements, the last ones, that are looked at: time grows with the square of their number."""


@dataclass(frozen=True)
class ChangePoint:
    """A change of level between two neighbouring measurements."""

    index: int
    """The place of the first measurement after it."""
    before: float
    """The median from the change before it, or the beginning, up to here."""
    after: float
    chance: float
    """The probability of so clear a change in a series without any."""


def change_points(values: np.ndarray) -> list[ChangePoint]:
    """Return the changes of a series [n] of finite numbers in their order; none in fewer than `FEWEST`."""
    skipped = max(0, len(values) - MOST)
    found = sorted(_splits(values[skipped:], skipped))
    if not found:
        return []
    ends = [skipped, *(index for index, _ in found), len(values)]
    for place in range(1, len(ends) - 1):
        ends[place] = _placed(values, *ends[place - 1 : place + 2])
    levels = [float(np.median(values[start:stop])) for start, stop in pairwise(ends)]
    return [
        ChangePoint(index, before, after, chance)
        for index, (before, after), (_, chance) in zip(ends[1:-1], pairwise(levels), found, strict=True)
    ]


def _placed(values: np.ndarray, start: int, index: int, stop: int) -> int:
    """Return the place near `index` at which both sides are nearest to their medians: ranks blur it by one or two."""

    def spread(place: int) -> float:
        sides = values[start:place], values[place:stop]
        return float(sum(np.abs(side - np.median(side)).sum() for side in sides))

    near = range(max(start + 1, index - LEAST + 1), min(stop, index + LEAST))
    return min(near, key=lambda place: (spread(place), abs(place - index)))


def _splits(values: np.ndarray, start: int) -> Iterator[tuple[int, float]]:
    """Return place and chance of each change in a piece that begins at `start`."""
    count = len(values)
    if count < FEWEST:
        return
    ranks = norm.ppf((rankdata(values) - 0.375) / (count + 0.25))  # normal scores, Blom 1958
    scores = ranks - ranks.mean()
    clearest, begin, end = max((float(clear[0].max()), begin, int(ends[clear[0].argmax()]))
                               for begin, ends, clear in _stretches(scores[None]))  # fmt: skip
    as_clear = _by_chance(np.sort(scores).tobytes()) >= clearest - 1e-12
    chance = float((1 + np.count_nonzero(as_clear)) / (ORDERS + 1))
    if chance > CHANCE:
        return
    yield from ((start + place, chance) for place in (begin, end) if 0 < place < count)
    for first, last in pairwise([0, *(place for place in (begin, end) if 0 < place < count), count]):
        yield from _splits(values[first:last], start + first)


def _stretches(scores: np.ndarray) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Return for series [k, n] of mean 0 each place where a stretch can begin, the places [m] where it can end, and how
    far its mean is from that of the rest, in standard errors, [k, m].
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
    """Return how clear the clearest stretch is in each of `ORDERS` random orders of scores."""
    scores = np.tile(np.frombuffer(sorted_scores), (ORDERS, 1))
    orders = np.random.default_rng(0).permuted(scores, axis=1)
    clearest: np.ndarray = np.max([clear.max(axis=1) for _, _, clear in _stretches(orders)], axis=0)
    return clearest
