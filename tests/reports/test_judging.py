"""Verdicts from figures and intervals."""

import numpy as np
import pytest
from scipy.stats import t as student

from reports.judging import (
    half_unit,
    interval_of_mean,
    judge_difference,
    judge_figures,
    judge_gain,
    judge_level,
)
from reports.ledger import UNTESTED


@pytest.mark.parametrize(
    ("printed", "unit", "half"),
    [
        (1.4, "", 0.05),
        (0.006, "", 0.0005),
        (257, "", 0.5),
        (67_000, "", 500),
        (1_370_000, "", 5000),
        (18, "%", 0.5),
        (33.0, "dB", 0.05),
        (4.2, "h", 0.05),
    ],
)
def test_rounding_of_printed_numbers(printed, unit, half):
    assert half_unit(printed, unit) == pytest.approx(half)


@pytest.mark.parametrize(
    ("measured", "verdict"),
    [
        ((0.2, 1.0), "does not hold"),
        ((0.2, 1.34), "does not hold"),
        ((0.2, 1.36), "inconclusive"),
        ((0.2, 3.0), "inconclusive"),
        ((1.36, 1.5), "holds"),
        ((2.0, 3.0), "holds"),
        (None, "inconclusive"),
    ],
)
def test_a_printed_difference_against_an_interval(measured, verdict):
    assert judge_difference(1.4, 0.05, measured) == verdict


def test_lost_cells_settle_no_claim_and_nothing_measured_tests_none():
    assert judge_gain(1.5, 0.05, 0.1, (0.0, 0.2), unpaired=1) == "inconclusive"
    assert judge_gain(1.5, 0.05, 0.1, (0.0, 0.2), unpaired=0) == "does not hold"
    assert judge_gain(1.5, 0.05, None, None, unpaired=0) == UNTESTED


@pytest.mark.parametrize(
    ("measured", "verdict"),
    [
        ((32.9, 33.1), "holds"),
        ((32.7, 33.1), "inconclusive"),
        ((20.0, 40.0), "inconclusive"),
        ((31.0, 32.7), "does not hold"),
        ((33.3, 35.0), "does not hold"),
        (None, "inconclusive"),
    ],
)
def test_a_printed_level_is_judged_from_both_sides(measured, verdict):
    assert judge_level(33.0, 0.2, measured) == verdict


@pytest.mark.parametrize(
    ("computed", "reachable", "verdict"),
    [
        (18.0, (17.5, 18.4), "holds"),
        (18.5, (18.4, 18.6), "holds"),
        (19.05, (16.9, 21.2), "inconclusive"),
        (19.05, (18.6, 19.5), "does not hold"),
        (16.0, (15.0, 17.4), "does not hold"),
    ],
)
def test_a_printed_result_against_what_it_is_made_of(computed, reachable, verdict):
    assert judge_figures(18.0, 0.5, computed, reachable) == verdict


def test_half_a_digit_in_binary_fractions_is_still_half_a_digit():
    assert judge_figures(1.5, 0.05, 1.45, (1.45, 1.45)) == "holds"
    assert judge_figures(32.5, 0.05, 32.449, (32.449, 32.449)) == "does not hold"


@pytest.mark.parametrize("many", [2, 3, 6, 10])
def test_the_interval_of_a_mean_is_students(many):
    values = np.random.default_rng(many).normal(30.0, 0.4, many)
    expected = student.interval(0.95, many - 1, values.mean(), values.std(ddof=1) / many**0.5)
    assert interval_of_mean(values.tolist()) == pytest.approx(expected, abs=1e-3)


def test_one_value_has_no_interval():
    assert interval_of_mean([30.0]) is None
