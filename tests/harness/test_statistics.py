"""Intervals, detectable effects and verdicts, held to what they promise by simulation."""

import math

import numpy as np
import pytest

from harness.statistics import PairedDifference, detectable_in_errors, over_scenes, paired_difference, verdict

REPETITIONS = 4000


def simulated(units: int, mean: float = 0.0, spread: float = 1.0, seed: int = 0) -> list[PairedDifference]:
    draws = np.random.default_rng(seed).normal(mean, spread, (REPETITIONS, units))
    return [paired_difference(row) for row in draws]


@pytest.mark.parametrize("units", [3, 8])
def test_95_percent_of_intervals_hold_the_truth(units: int) -> None:
    results = simulated(units, mean=0.3, spread=0.7)
    held = [one.interval is not None and one.interval[0] <= 0.3 <= one.interval[1] for one in results]
    # four standard errors of the share
    assert np.mean(held) == pytest.approx(0.95, abs=4 * math.sqrt(0.05 * 0.95 / REPETITIONS))


@pytest.mark.parametrize("units", [3, 8])
def test_a_method_against_itself_is_told_apart_in_5_percent_at_most(units: int) -> None:
    verdicts = [verdict(one, 1e-9, True) for one in simulated(units, seed=1)]
    false = np.mean([said in ("better", "worse") for said in verdicts])
    assert 0.03 < false < 0.05 + 4 * math.sqrt(0.05 * 0.95 / REPETITIONS)
    assert verdicts.count("better") == pytest.approx(verdicts.count("worse"), abs=60)


@pytest.mark.parametrize("units", [2, 3, 8, 24])
def test_the_smallest_detectable_difference_is_found_in_80_percent(units: int) -> None:
    effect = detectable_in_errors(units) / math.sqrt(units)
    found = np.mean([verdict(one, 1e-9, True) == "better" for one in simulated(units, mean=effect, seed=2)])
    assert found == pytest.approx(0.80, abs=4 * math.sqrt(0.8 * 0.2 / REPETITIONS))


def test_the_smallest_detectable_difference_scales_with_the_measured_spread() -> None:
    result = paired_difference(np.array([1.0, 2.0, 3.0]))
    assert result.smallest_detectable == pytest.approx(detectable_in_errors(3) / math.sqrt(3))
    wider = paired_difference(np.array([10.0, 20.0, 30.0]))
    assert wider.smallest_detectable == pytest.approx(10 * (result.smallest_detectable or 0))


def test_many_units_detect_what_the_normal_distribution_says() -> None:
    assert detectable_in_errors(100_000) == pytest.approx(1.959964 + 0.841621, abs=1e-3)


def test_the_interval_is_students() -> None:
    result = paired_difference(np.array([1.0, 2.0, 3.0]))
    half = 4.302653 / math.sqrt(3)  # t of 2 degrees of freedom at 97.5 %
    assert result.mean == 2.0
    assert result.interval == pytest.approx((2 - half, 2 + half), rel=1e-6)
    assert result.units == 3


def test_one_unit_has_no_interval_and_no_verdict() -> None:
    result = paired_difference(np.array([5.0]))
    assert result == PairedDifference(5.0, None, None, 1)
    assert verdict(result, 0.2, True) == "inconclusive"


@pytest.mark.parametrize("values", [[], [1.0, math.nan], [math.inf], [1.0, -math.inf]])
def test_differences_that_are_not_numbers_are_refused(values: list[float]) -> None:
    with pytest.raises(ValueError, match="finite and not empty"):
        paired_difference(np.array(values))


@pytest.mark.parametrize(
    ("interval", "higher", "lower"),
    [
        ((0.3, 0.9), "better", "worse"),
        ((-0.9, -0.3), "worse", "better"),
        ((0.01, 0.9), "better", "worse"),
        ((-0.5, 0.5), "inconclusive", "inconclusive"),
        ((0.0, 0.5), "inconclusive", "inconclusive"),
        ((-0.1, 0.15), "equivalent", "equivalent"),
        ((0.05, 0.15), "equivalent", "equivalent"),
        ((-0.15, -0.05), "equivalent", "equivalent"),
        ((0.05, 0.25), "better", "worse"),
        ((-0.2, 0.1), "inconclusive", "inconclusive"),
        ((0.0, 0.0), "equivalent", "equivalent"),
        (None, "inconclusive", "inconclusive"),
    ],
)
def test_what_an_interval_allows_to_say(interval: tuple[float, float] | None, higher: str, lower: str) -> None:
    result = PairedDifference(0.0, interval, None, 3)
    assert verdict(result, 0.2, higher_is_better=True) == higher
    assert verdict(result, 0.2, higher_is_better=False) == lower


def test_scenes_are_the_units_where_there_are_several() -> None:
    result = over_scenes({"a": np.array([1.0, 3.0]), "b": np.array([4.0, 4.0, 4.0])})
    assert result == paired_difference(np.array([2.0, 4.0]))


def test_seeds_are_the_units_of_a_single_scene() -> None:
    values = np.array([1.0, 3.0, 2.0])
    assert over_scenes({"a": values}) == paired_difference(values)


def test_more_seeds_of_the_same_scenes_do_not_count_as_more_scenes() -> None:
    few = over_scenes({"a": np.array([1.0]), "b": np.array([4.0])})
    many = over_scenes({"a": np.full(50, 1.0), "b": np.full(50, 4.0)})
    assert few == many
    assert few.units == 2
