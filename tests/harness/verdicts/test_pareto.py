"""The best method, the Pareto front and crossings of tables with known answers."""

import math

import numpy as np
import pytest

from harness.verdicts.pareto import best_shares, crossing, drawn_means, front_shares, rank_correlation, resamples


def test_each_method_is_best_in_the_share_of_draws_in_which_its_mean_is() -> None:
    """The first is best on average unless only the second scene is drawn, which is one of four draws."""
    assert best_shares(np.array([[30.0, 20.0], [25.0, 24.0]])) == pytest.approx([0.75, 0.25], abs=0.02)
    assert best_shares(np.array([[20.0, 21.0, 22.0], [19.0, 20.0, 21.0]])).tolist() == [1.0, 0.0]


def test_a_method_without_a_score_on_a_drawn_scene_is_never_best() -> None:
    table = np.array([[99.0, math.nan], [10.0, 10.0]])
    weights = np.array([[1.0, 0.0], [0.5, 0.5]])
    assert drawn_means(table, weights).tolist() == [[99.0, -math.inf], [10.0, 10.0]]
    assert best_shares(table) == pytest.approx([0.25, 0.75], abs=0.02)
    assert best_shares(np.full((2, 3), math.nan)).tolist() == [0.0, 0.0]


def test_the_front_holds_who_is_better_and_no_longer_training_that_gains_nothing() -> None:
    early, late = np.array([[20.0, 21.0], [19.0, 20.0]]), np.array([[20.5, 21.5], [30.0, 31.0]])
    assert front_shares([early, late]).tolist() == [[1.0, 0.0], [0.0, 1.0]]
    table = np.array([[20.0, 21.0]])
    gains_nothing, gains = table - 1.0, table + 1.0
    assert front_shares([table, gains_nothing, gains]).tolist() == [[1.0], [0.0], [1.0]]


def test_draws_are_those_of_a_bootstrap_and_always_the_same() -> None:
    weights = resamples(8)
    assert weights.sum(axis=1) == pytest.approx(1.0)
    assert weights.mean(axis=0) == pytest.approx(np.full(8, 1 / 8), abs=0.01)
    assert weights.var(axis=0) == pytest.approx(np.full(8, 7 / 8**3), rel=0.1)
    assert np.array_equal(weights, resamples(8))


def test_lines_cross_where_the_difference_is_0_on_a_logarithmic_axis() -> None:
    budgets = [1.0, 4.0, 16.0]
    flat, rising = np.full((3, 2), 20.0), np.array([[18.0], [20.0], [22.0]]) + np.array([[0.0, 0.0]])
    at, (low, high), share = crossing(budgets, flat, rising) or (0.0, (0.0, 0.0), 0.0)
    assert (at, low, high, share) == pytest.approx((4.0, 4.0, 4.0, 1.0))
    halfway = crossing(budgets, flat, rising - 1.0)
    assert halfway[0] == pytest.approx(8.0)
    apart = crossing(budgets, flat, np.array([[18.0, 18.0], [19.0, 21.0], [22.0, 22.0]]))
    assert apart[1][0] < 4.0 < apart[1][1]


def test_lines_that_do_not_cross_for_good_have_no_crossing() -> None:
    budgets, flat = [1.0, 4.0], np.full((2, 2), 20.0)
    for other in ([[21.0], [22.0]], [[18.0], [19.0]], [[21.0], [19.0]], [[math.nan], [21.0]]):
        assert crossing(budgets, flat, np.array(other) + np.zeros((1, 2))) is None


def test_rank_correlation_is_kendalls() -> None:
    assert rank_correlation(np.array([1.0, 2.0, 3.0]), np.array([10.0, 20.0, 30.0])) == pytest.approx(1.0)
    assert rank_correlation(np.array([1.0, 2.0, 3.0]), np.array([3.0, 2.0, 1.0])) == pytest.approx(-1.0)
    assert rank_correlation(np.array([1.0, 2.0, 3.0, 4.0]), np.array([2.0, 1.0, 3.0, 4.0])) == pytest.approx(4 / 6)
    assert rank_correlation(np.array([1.0, 1.0, 2.0]), np.array([1.0, 2.0, 3.0])) == pytest.approx(2 / math.sqrt(6))
    assert math.isnan(rank_correlation(np.array([1.0, 1.0]), np.array([1.0, 2.0])))
