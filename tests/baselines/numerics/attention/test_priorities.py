"""Eq. 7, order and allocation against slow exact arithmetic."""

import math
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baselines.numerics.attention.priorities import (
    PHI,
    BadAttention,
    allocated_bins,
    is_equal,
    priorities,
    region_order,
    shares,
    without_phi,
)

EXTREMES = [
    np.array([1e300, 1.5e308, 1e-300, 0.0, 1.7e308]),
    np.array([5e-324, 1e-323, 0.0, 1.5e-323]),
    np.array([1e-300, 2e-300, 3e-300, 1e300]),
]
EVERY: list[Callable[[np.ndarray], object]] = [priorities, shares, region_order, is_equal]


def test_priorities_are_phi_times_the_shares() -> None:
    found = priorities(np.array([1.0, 3.0, 0.0, 4.0]))
    np.testing.assert_allclose(found, (1 + math.sqrt(5)) / 2 * np.array([0.125, 0.375, 0.0, 0.5]), rtol=1e-15)
    assert found.sum() == pytest.approx(1.618033988749895, rel=1e-15)


@pytest.mark.parametrize("attention", EXTREMES)
def test_tiny_and_huge_attention_neither_overflows_nor_loses_its_order(attention: np.ndarray) -> None:
    found = priorities(attention)
    assert np.isfinite(found).all()
    assert found.sum() == pytest.approx(PHI, rel=1e-14)
    exact = sorted(range(len(attention)), key=lambda region: (-Fraction(attention[region]), region))
    assert region_order(attention).tolist() == exact
    assert (np.diff(found[exact]) <= 0.0).all()
    bins = allocated_bins(attention, np.full(len(attention), 7), 12, 2)
    assert (np.diff(bins[exact]) <= 0).all()
    assert bins.sum() == 12 * len(attention)


def test_no_attention_at_all_is_equal_attention() -> None:
    nothing = np.zeros(5)
    assert is_equal(nothing)
    np.testing.assert_allclose(priorities(nothing), PHI / 5, rtol=1e-15)
    assert region_order(nothing).tolist() == [0, 1, 2, 3, 4]
    assert allocated_bins(nothing, np.array([9, 9, 9, 3, 1]), 8, 2).tolist() == [8] * 5


@pytest.mark.parametrize("value", [-1.0, -5e-324, np.nan, np.inf, -np.inf])
def test_a_region_that_has_no_attention_to_give_is_named(value: float) -> None:
    attention = np.array([1.0, 2.0, value, 3.0])
    for function in (*EVERY, lambda a: allocated_bins(a, np.ones(4), 8, 1)):
        with pytest.raises(BadAttention, match=rf"region 2: attention {value:g}"):
            function(attention)


@pytest.mark.parametrize(
    ("attention", "said"),
    [
        (np.zeros(0), "is empty"),
        (np.ones((2, 2)), r"shape \[2, 2\]"),
        (np.array(1.0), r"shape \[\]"),
        (np.ones(2) * 1j, "complex"),
        (np.array(["much", "little"]), "not made of numbers"),
    ],
)
def test_what_is_no_list_of_numbers_is_refused(attention: np.ndarray, said: str) -> None:
    for function in EVERY:
        with pytest.raises(BadAttention, match=said):
            function(attention)


def test_equal_regions_keep_their_order_and_those_without_attention_come_last() -> None:
    assert region_order(np.array([0.0, 2.0, 1.0, 2.0, 0.0, -0.0])).tolist() == [1, 3, 2, 0, 4, 5]


def test_what_differs_by_rounding_alone_is_equal() -> None:
    once = 0.1 + 0.2
    assert once != 0.3
    assert region_order(np.array([0.3, once, 0.3])).tolist() == [0, 1, 2]
    assert is_equal(np.array([0.3, once]))
    assert not is_equal(np.array([0.3, 0.3 * (1 + 1e-9)]))


def slow_allocation(attention: list[int], rays: list[int], bins: int, least: int) -> list[int]:
    """The docstring of `allocated_bins`, in exact fractions."""
    if len(set(attention)) == 1:
        return [bins] * len(rays)
    free = (bins - least) * sum(rays)
    weight = sum(a * n for a, n in zip(attention, rays, strict=True))
    wanted = [Fraction(free * a, weight) for a in attention]
    whole = [math.floor(one) for one in wanted]
    left = free - sum(one * n for one, n in zip(whole, rays, strict=True))
    for region in sorted(range(len(rays)), key=lambda region: (whole[region] - wanted[region], region)):
        if rays[region] <= left:
            whole[region] += 1
            left -= rays[region]
    return [least + one for one in whole]


SOME = st.lists(st.tuples(st.integers(0, 60), st.integers(1, 30)), min_size=1, max_size=12)


@settings(max_examples=300, deadline=None)
@given(SOME, st.integers(1, 40), st.integers(1, 8), st.sampled_from([1.0, 0.1, 3.0, 1e-300, 1e300, 2.0**-1060]))
def test_allocation_is_that_of_the_slow_reference_at_any_scale(
    some: list[tuple[int, int]], bins: int, least: int, scale: float
) -> None:
    attention, rays = [a for a, _ in some], [n for _, n in some]
    least = min(least, bins)
    found = allocated_bins(np.array(attention, float) * scale, np.array(rays), bins, least)
    assert found.tolist() == slow_allocation(attention, rays, bins, least)
    assert found.min() >= least
    spent = int((found * rays).sum())
    assert bins * sum(rays) - max(rays) < spent <= bins * sum(rays)


def test_the_total_is_not_exceeded_in_a_picture_of_eight_million_pixels() -> None:
    attention = np.tile([1.0, 2.0, 3.0], 3000)
    rays = np.full(9000, 900)
    assert (allocated_bins(attention, rays, 7, 1) * rays).sum() <= 7 * rays.sum()


def test_phi_changes_neither_order_nor_allocation_only_the_sum() -> None:
    generator = np.random.default_rng(7)
    for _ in range(100):
        attention = generator.exponential(size=80) * 10.0 ** generator.uniform(-200, 200)
        assert without_phi(attention, np.full(80, 100), 16, 4) == (pytest.approx(PHI, rel=1e-14), False, False)


def test_a_factor_that_is_not_the_same_for_all_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    attention = np.array([1.0, 2.0, 3.0])
    uneven = "baselines.numerics.attention.priorities.priorities"
    monkeypatch.setattr(uneven, lambda a: PHI * shares(a) ** np.array([1.0, 1.0, 8.0]))
    _, *changes = without_phi(attention, np.ones(3, int), 9, 1)
    assert changes == [True, True]
