"""Eq. 7: attention → priorities, the order of regions and the samples that each of them gets.

`attention` is an array [regions] of numbers ≥ 0 of any scale, the mean attention of each region's pixels. All zero is
taken as equal attention, which is plain rendering.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

PHI = (1.0 + math.sqrt(5.0)) / 2.0
TIE = 1e-12
"""The relative difference below which two attentions are equal: the sums that they come from are no more exact."""
BINARY_PLACES = 20
"""The binary places to which a number of bins is rounded before its integer part is taken, for the same reason. With
more of them, rounding up could exceed the total where there are many rays.
"""


class BadAttention(ValueError):
    """Attention from which no priority follows. Names the region and its value."""


def checked(attention: np.ndarray, count: int | None = None) -> NDArray[np.float64]:
    """Return `attention` as float64 [regions], at least one; raises `BadAttention` unless finite and ≥ 0."""
    if np.iscomplexobj(attention):
        raise BadAttention("attention is complex: a priority has a size alone")
    try:
        given = np.asarray(attention, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BadAttention(f"attention is not made of numbers: {error}") from error
    if given.ndim != 1 or (count is not None and len(given) != count):
        wanted = "[regions]" if count is None else f"[{count}]"
        raise BadAttention(f"attention has the shape {list(given.shape)}: must be {wanted}, one number for each region")
    if not len(given):
        raise BadAttention("attention is empty: there is no region to render")
    bad = ~(np.isfinite(given) & (given >= 0.0))
    if bad.any():
        region = int(bad.argmax())
        others = f", and {bad.sum() - 1} more" if bad.sum() > 1 else ""
        raise BadAttention(f"region {region}: attention {given[region]:g}{others}; must be finite and not below 0")
    return given


def is_equal(attention: np.ndarray) -> bool:
    """Tell whether no region is attended more than another (to `TIE`), which also holds where nothing is attended."""
    given = checked(attention)
    return bool(given.min() >= given.max() * (1.0 - TIE))


def shares(attention: np.ndarray) -> NDArray[np.float64]:
    """Return attention / Σ attention, float64 [regions]; all zero gives equal shares. Σ = 1 up to rounding."""
    given = checked(attention)
    largest = float(given.max())
    # divide by the largest first, so that the sum neither overflows nor is 0
    relative = given / largest if largest > 0.0 else np.ones_like(given)
    return relative / float(relative.sum())


def priorities(attention: np.ndarray) -> NDArray[np.float64]:
    """Return P = φ · attention / Σ attention (Eq. 7), float64 [regions].

    φ scales all priorities alike. Order and allocation depend on their ratios alone, so that both are the same with
    any positive factor in its place (`without_phi` measures it); the priorities sum to φ = 1.618…, so they are no
    probabilities. An attention below 1e-308 of the largest has the priority 0, as float64 has nothing smaller, but
    still its place in `region_order`. Raises `BadAttention`.
    """
    return PHI * shares(attention)


def region_order(attention: np.ndarray) -> np.ndarray:
    """Return all regions, most attended first, ties (`TIE`) row by row; raises `BadAttention`."""
    given = checked(attention)
    falling = np.argsort(-given, kind="stable")
    inorder = given[falling]
    rank = np.empty(len(given), dtype=np.int64)
    rank[falling] = np.concatenate([[0], np.cumsum(inorder[1:] < inorder[:-1] * (1.0 - TIE))])
    return np.argsort(rank, kind="stable")


def allocated_bins(attention: np.ndarray, rays: np.ndarray, bins: float, least: int = 1) -> np.ndarray:
    """Return bins per ray in each region, int [regions], at the total of `bins` per ray everywhere.

    Each ray gets `least` bins, and of what is left a part proportional to the attention of its region; whole numbers by
    largest remainder (equal ones row by row). The total Σ rays · bins is never exceeded; it is met exactly where all
    regions have as many rays, else what is left over is less than the largest region has rays. Equal attention gives
    `bins` everywhere. `bins` is a mean and need not be whole (equal attention rounds it down).
    Raises `BadAttention`, and `ValueError` unless 1 ≤ least ≤ bins and each region has a ray.
    """
    given = checked(attention)
    counts = np.asarray(rays)
    if counts.shape != given.shape or counts.min() < 1:
        raise ValueError(f"rays {counts.shape}: must be at least one in each of {len(given)} regions")
    if not 1 <= least <= bins:
        raise ValueError(f"at least {least} of {bins} bins a ray: must lie between 1 and {bins}")
    if is_equal(given):
        return np.full(len(given), int(bins))
    relative = given / given.max()
    free = int((bins - least) * int(counts.sum()))
    step = 2.0 ** -max(BINARY_PLACES, int(counts.sum()).bit_length())
    wanted = np.round(free * relative / (relative * counts).sum() / step) * step
    more: NDArray[np.int64] = np.floor(wanted).astype(np.int64)
    left = free - int((more * counts).sum())
    for region in np.argsort(more - wanted, kind="stable"):
        if counts[region] <= left:
            more[region] += 1
            left -= int(counts[region])
    return least + more


def in_steps(bins: np.ndarray, rays: np.ndarray, ratio: float = math.sqrt(2.0)) -> np.ndarray:
    """Round bins per ray, int [regions], to few different values: each one of a ladder of factor `ratio` up from the
    least, at no more than the total Σ rays · bins of those given.

    Regions with as many bins share a chunk, and the overhead of a chunk is more than what a region's own number of bins
    gains. Each is rounded down; then those that lost most, by their ratio, go up while the total allows it.
    Raises `ValueError` unless `ratio` > 1 and every number is at least 1.
    """
    wanted, counts = np.asarray(bins), np.asarray(rays)
    if wanted.ndim != 1 or counts.shape != wanted.shape or not len(wanted) or min(wanted.min(), counts.min()) < 1:
        raise ValueError(f"bins {wanted.shape} and rays {counts.shape}: at least one each in each region")
    if not ratio > 1.0:
        raise ValueError(f"ratio {ratio}: must be above 1")
    least, most = int(wanted.min()), int(wanted.max())
    steps = np.unique([min(most, round(least * ratio**k)) for k in range(math.ceil(math.log(most / least, ratio)) + 1)])
    level = np.searchsorted(steps, wanted, side="right") - 1
    left = int(((wanted - steps[level]) * counts).sum())
    for region in np.argsort(steps[level] / wanted, kind="stable"):
        if wanted[region] == steps[level[region]]:
            continue
        more = int((steps[level[region] + 1] - steps[level[region]]) * counts[region])
        if more <= left:
            level[region] += 1
            left -= more
    return steps[level]


class PhiEffect(NamedTuple):
    """The effect of the factor φ of Eq. 7 for one map of attention."""

    sum_of_priorities: float
    order_changed: bool
    allocation_changed: bool


def without_phi(attention: np.ndarray, rays: np.ndarray, bins: int, least: int = 1) -> PhiEffect:
    """Compare order and allocation by P with those by the shares, which lack the factor: measured, not assumed."""
    with_it, without = priorities(attention), shares(attention)
    same_order = np.array_equal(region_order(with_it), region_order(without))
    bins_with, bins_without = (allocated_bins(each, rays, bins, least) for each in (with_it, without))
    return PhiEffect(float(with_it.sum()), not same_order, not np.array_equal(bins_with, bins_without))
