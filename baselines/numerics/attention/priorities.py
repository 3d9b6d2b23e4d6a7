"""Eq. 7: attention → priorities, the order of regions and the samples of each region.

`attention` is an array [regions] of numbers ≥ 0 of any scale, the mean attention of each region's pixels. All zero
counts as equal attention, which leads to plain rendering.
"""

import math

import numpy as np
from numpy.typing import NDArray

PHI = (1.0 + math.sqrt(5.0)) / 2.0
TIE = 1e-12
"""The relative difference below which two attentions are equal: the sums that they come from are not more exact."""
BINARY_PLACES = 20
"""The binary places to which a number of bins is rounded before its integer part is taken, for the same reason. With
more places, rounding up could exceed the total where there are many rays.
"""


class BadAttention(ValueError):
    """Attention from which no priority follows; the message names the region and its value."""


def checked(attention: np.ndarray, count: int | None = None) -> NDArray[np.float64]:
    """Return `attention` as float64 [regions], at least one; raises `BadAttention` unless finite and ≥ 0."""
    if np.iscomplexobj(attention):
        raise BadAttention("attention is complex: a priority is a real number")
    try:
        given = np.asarray(attention, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise BadAttention(f"attention is not made of numbers: {error}") from error
    if given.ndim != 1 or (count is not None and len(given) != count):
        shape = "[regions]" if count is None else f"[{count}]"
        raise BadAttention(f"attention has the shape {list(given.shape)}: must be {shape}, one number per region")
    if not len(given):
        raise BadAttention("attention is empty: there is no region to render")
    bad = ~(np.isfinite(given) & (given >= 0.0))
    if bad.any():
        region = int(bad.argmax())
        others = f", and {bad.sum() - 1} more" if bad.sum() > 1 else ""
        raise BadAttention(f"region {region}: attention {given[region]:g}{others}; must be finite and not below 0")
    return given


def is_equal(attention: np.ndarray) -> bool:
    """Return whether all regions have equal attention (to `TIE`), which also holds if all of it is 0."""
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

    φ scales all priorities alike. Order and allocation depend only on their ratios, so that both are the same with any
    other positive factor (`without_phi` measures it). The priorities sum to φ = 1.618…, so they are not probabilities.
    An attention below 1e-308 of the largest has the priority 0, as float64 has no smaller number, but keeps its place
    in `region_order`. Raises `BadAttention`.
    """
    return PHI * shares(attention)


def region_order(attention: np.ndarray) -> np.ndarray:
    """Return all regions in falling order of attention, ties (`TIE`) row by row. Raises `BadAttention`."""
    given = checked(attention)
    falling = np.argsort(-given, kind="stable")
    inorder = given[falling]
    rank = np.empty(len(given), dtype=np.int64)
    rank[falling] = np.concatenate([[0], np.cumsum(inorder[1:] < inorder[:-1] * (1.0 - TIE))])
    return np.argsort(rank, kind="stable")


def allocated_bins(attention: np.ndarray, rays: np.ndarray, bins: int, least: int) -> np.ndarray:
    """Return bins per ray in each region, int [regions], for a mean of `bins` per ray; 1 ≤ `least` ≤ `bins`, and each
    region has at least one of `rays`.

    Each ray gets `least` bins, and a part of the remaining bins in proportion to the attention of its region; integers
    follow from the largest remainder (ties row by row). The total Σ rays · bins is never exceeded. It is met exactly if
    all regions have equally many rays; otherwise the rest is smaller than the number of rays of the largest region.
    Equal attention gives `bins` everywhere. Raises `BadAttention`.
    """
    given = checked(attention)
    if is_equal(given):
        return np.full(len(given), bins)
    relative = given / given.max()
    total = int(rays.sum())
    free = (bins - least) * total
    step = 2.0 ** -max(BINARY_PLACES, total.bit_length())
    exact = np.round(free * relative / (relative * rays).sum() / step) * step
    more: NDArray[np.int64] = np.floor(exact).astype(np.int64)
    left = free - int((more * rays).sum())
    for region in np.argsort(more - exact, kind="stable"):
        if rays[region] <= left:
            more[region] += 1
            left -= int(rays[region])
    return least + more


def without_phi(attention: np.ndarray, rays: np.ndarray, bins: int, least: int) -> tuple[float, bool, bool]:
    """Return Σ P, and whether the order of regions and the numbers of bins differ from those without φ, by shares."""
    with_it, without = priorities(attention), shares(attention)
    same_order = np.array_equal(region_order(with_it), region_order(without))
    bins_with, bins_without = (allocated_bins(each, rays, bins, least) for each in (with_it, without))
    return float(with_it.sum()), not same_order, not np.array_equal(bins_with, bins_without)
