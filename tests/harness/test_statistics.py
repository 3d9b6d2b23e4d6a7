"""Intervals, detectable effects and verdicts, held to what they promise by simulation."""

import math

import numpy as np
import pytest
from scipy.stats import nct

from harness.statistics import (
    PairedDifference,
    critical,
    crossed,
    crossed_error,
    detectable,
    over_scenes,
    paired_difference,
    share_found,
    shift_found,
    verdict,
)

REPETITIONS = 4000


def simulated(units: int, mean: float = 0.0, spread: float = 1.0, seed: int = 0) -> list[PairedDifference]:
    draws = np.random.default_rng(seed).normal(mean, spread, (REPETITIONS, units))
    return [paired_difference(row) for row in draws]


def chance(share: float, repetitions: int = REPETITIONS) -> float:
    """Four standard errors of a share."""
    return 4 * math.sqrt(share * (1 - share) / repetitions)


@pytest.mark.parametrize("units", [3, 8])
def test_95_percent_of_intervals_hold_the_truth(units: int) -> None:
    results = simulated(units, mean=0.3, spread=0.7)
    held = [one.interval is not None and one.interval[0] <= 0.3 <= one.interval[1] for one in results]
    assert np.mean(held) == pytest.approx(0.95, abs=chance(0.05))


@pytest.mark.parametrize("units", [3, 8])
def test_a_method_against_itself_is_told_apart_in_5_percent_at_most(units: int) -> None:
    verdicts = [verdict(one, 1e-9, True) for one in simulated(units, seed=1)]
    false = np.mean([said in ("better", "worse") for said in verdicts])
    assert 0.03 < false < 0.05 + chance(0.05)
    assert verdicts.count("better") == pytest.approx(verdicts.count("worse"), abs=60)


@pytest.mark.parametrize("family", [1, 8, 48])
@pytest.mark.parametrize("units", [2, 3, 8, 24])
def test_the_difference_that_is_printed_for_the_true_spread_is_found_in_80_percent(units: int, family: int) -> None:
    """One size for all repetitions: that each finds what it prints itself would say nothing of a true effect."""
    planted = paired_difference(of_spread_1(units), family).smallest_detectable
    assert planted is not None
    draws = np.random.default_rng(2).normal(planted, 1, (REPETITIONS, units))
    found = [verdict(paired_difference(row, family), 1e-9, True) == "better" for row in draws]
    assert np.mean(found) == pytest.approx(0.80, abs=chance(0.2))


@pytest.mark.parametrize("family", [1, 8, 48, 1000])
@pytest.mark.parametrize("freedom", [1.0, 1.3, 2.0, 7.0, 23.0, 999.0])
def test_what_is_found_is_the_noncentral_t_distributions_tail(freedom: float, family: int) -> None:
    threshold = critical(freedom, family)
    shift = shift_found(threshold, freedom)
    assert nct.sf(threshold, freedom, shift) == pytest.approx(0.80, abs=1e-4)
    for other in (0.3 * shift, 0.8 * shift, 1.5 * shift):
        assert share_found(other, threshold, freedom) == pytest.approx(nct.sf(threshold, freedom, other), abs=1e-4)


def of_spread_1(units: int) -> np.ndarray:
    values = np.linspace(-1.0, 1.0, units)
    return values / values.std(ddof=1)


def test_the_smallest_detectable_difference_scales_with_the_measured_spread() -> None:
    result = paired_difference(np.array([1.0, 2.0, 3.0]))
    # t of 2 degrees of freedom is 4.302653 at 97.5 %; noncentral by 5.653489 it is beyond in 80 %
    assert result.smallest_detectable == pytest.approx(5.653489 / math.sqrt(3), rel=1e-5)
    wider = paired_difference(np.array([10.0, 20.0, 30.0]))
    assert wider.smallest_detectable == pytest.approx(10 * (result.smallest_detectable or 0))


def test_many_units_detect_what_the_normal_distribution_says() -> None:
    values = np.random.default_rng(3).normal(0, 1, 100_000)
    expected = (1.959964 + 0.841621) * values.std(ddof=1) / math.sqrt(100_000)
    assert paired_difference(values).smallest_detectable == pytest.approx(expected, rel=1e-3)


def test_the_interval_is_students() -> None:
    result = paired_difference(np.array([1.0, 2.0, 3.0]))
    half = 4.302653 / math.sqrt(3)  # t of 2 degrees of freedom at 97.5 %
    assert result.mean == 2.0
    assert result.interval == pytest.approx((2 - half, 2 + half), rel=1e-6)
    assert result.simultaneous == result.interval
    assert result.units == 3


def test_a_family_widens_the_interval_of_the_verdict_alone() -> None:
    values = np.array([1.0, 2.0, 3.0])
    one, of_eight = paired_difference(values), paired_difference(values, 8)
    assert of_eight.interval == one.interval
    assert of_eight.simultaneous is not None
    half = 12.590 / math.sqrt(3)  # t of 2 degrees of freedom at 1 − 0.025 / 8
    assert of_eight.simultaneous == pytest.approx((2 - half, 2 + half), rel=1e-3)
    assert critical(2, 1) < critical(2, 2) < critical(2, 8)


def test_a_whole_family_holds_the_truth_in_95_percent() -> None:
    """Eight scenes of three seeds each, one interval a scene: independent, so Bonferroni wastes next to nothing."""
    draws = np.random.default_rng(4).normal(0, 1, (1000, 8, 3))
    missed = alone = 0
    for table in draws:
        results = [paired_difference(row, 8) for row in table]
        missed += any(one.simultaneous is None or one.simultaneous[0] > 0 or one.simultaneous[1] < 0 for one in results)
        alone += any(one.interval is None or one.interval[0] > 0 or one.interval[1] < 0 for one in results)
    assert missed / 1000 == pytest.approx(1 - (1 - 0.05 / 8) ** 8, abs=chance(0.05, 1000))
    assert alone / 1000 > 0.25  # what would come of eight uncorrected looks


def test_one_unit_has_no_interval_and_no_verdict() -> None:
    result = paired_difference(np.array([5.0]))
    assert result == PairedDifference(5.0, None, None, 1)
    assert verdict(result, 0.2, True) == "inconclusive"
    assert detectable(result, 0.2) is None


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
    """The simultaneous one: what a comparison would say by itself does not count."""
    result = PairedDifference(0.0, (7.0, 8.0), None, 3, interval)
    assert verdict(result, 0.2, higher_is_better=True) == higher
    assert verdict(result, 0.2, higher_is_better=False) == lower


@pytest.mark.parametrize("of_interest", [1e-9, 1.0, 2.0, 5.0, 50.0])
@pytest.mark.parametrize("units", [3, 8])
def test_a_detectable_effect_is_called_better_and_not_equivalent(units: int, of_interest: float) -> None:
    """Spread 1, eight units: an interval of ± 0.8 lies within ± 5 unless the effect is far beyond what 0 would need."""
    planted = detectable(paired_difference(of_spread_1(units)), of_interest)
    assert planted is not None
    draws = np.random.default_rng(5).normal(planted, 1, (REPETITIONS, units))
    found = [verdict(paired_difference(row), of_interest, True) == "better" for row in draws]
    assert np.mean(found) == pytest.approx(0.80, abs=chance(0.2))


def test_without_any_spread_an_effect_of_interest_is_detectable() -> None:
    result = paired_difference(np.array([1.0, 1.0, 1.0]))
    assert (result.smallest_detectable, detectable(result, 0.2)) == (0.0, 0.2)


def closed_form(table: np.ndarray) -> float:
    """Variance of the pigeonhole bootstrap's mean of a complete table, from its two-way decomposition, corrected."""
    scenes, seeds = table.shape
    mean = table.mean()
    a, b = table.mean(axis=1) - mean, table.mean(axis=0) - mean
    e = table - mean - a[:, None] - b[None, :]
    by_scene, by_seed, rest = (a**2).mean() / scenes, (b**2).mean() / seeds, (e**2).mean() / (scenes * seeds)
    few = scenes / (scenes - 1)
    return float(by_scene * few + by_seed * (seeds / (seeds - 1) if seeds > 1 else 0.0) + rest * few)


@pytest.mark.parametrize(("scenes", "seeds"), [(2, 2), (8, 3), (3, 6), (20, 10), (8, 1)])
def test_the_bootstrap_of_a_complete_table_has_its_closed_form(scenes: int, seeds: int) -> None:
    draw = np.random.default_rng(scenes).normal
    table = draw(0, 1, (scenes, seeds)) + draw(0, 1, (scenes, 1)) + draw(0, 0.5, (1, seeds))
    # 4000 resamples know a standard deviation to 1.1 %
    assert crossed_error(table) == pytest.approx(math.sqrt(closed_form(table)), rel=0.05)


def test_degrees_of_freedom_are_those_of_whatever_varies() -> None:
    scenes, seeds = np.arange(8.0)[:, None], np.arange(3.0)[None, :]
    assert crossed(scenes + 0 * seeds)[1] == pytest.approx(7)
    assert crossed(0 * scenes + seeds)[1] == pytest.approx(2)
    assert crossed(np.arange(8.0)[:, None])[1] == pytest.approx(7)
    assert crossed(np.zeros((8, 3))) == (0.0, 7.0)
    between = crossed(scenes + seeds * math.sqrt(8 * 7 / 12))[1]  # variances of both means about alike
    assert 2 < between < 7


def test_missing_cells_neither_count_nor_poison() -> None:
    table = np.random.default_rng(6).normal(0, 1, (8, 3)) + np.arange(8.0)[:, None]
    holes = table.copy()
    holes[2, 1] = holes[5, 0] = math.nan
    result = over_scenes({str(place): row for place, row in enumerate(holes)})
    assert result.mean == pytest.approx(np.mean([row[np.isfinite(row)].mean() for row in holes]))
    assert crossed_error(holes) == pytest.approx(crossed_error(table), rel=0.15)
    assert result.units == 8


def test_a_table_that_allows_no_bootstrap_is_refused() -> None:
    for table in (np.ones((1, 3)), np.array([[1.0, 2.0], [math.nan, math.nan]])):
        with pytest.raises(ValueError, match="two scenes or more"):
            crossed_error(table)


@pytest.mark.parametrize(
    ("by_scene", "by_seed", "by_cell", "most"),
    [
        (0.0, 0.0, 1.0, 0.05),  # A/A: nothing but noise
        (1.0, 0.0, 0.3, 0.05),
        (1.0, 0.5, 0.5, 0.05),
        (0.3, 0.3, 1.0, 0.05),
        (0.0, 1.0, 0.0, 0.05),  # all scenes alike: three units, whatever the number of scenes
        (0.0, 1.0, 0.5, 0.09),  # the worst: hardly ever, and a little over
    ],
)
def test_eight_scenes_of_three_seeds_raise_no_more_false_alarms_than_promised(
    by_scene: float, by_seed: float, by_cell: float, most: float
) -> None:
    draw = np.random.default_rng(7).normal
    alarms = []
    for _ in range(500):
        table = draw(0, by_scene, (8, 1)) + draw(0, by_seed, (1, 3)) + draw(0, by_cell, (8, 3))
        result = over_scenes({str(place): row for place, row in enumerate(table)})
        alarms.append(verdict(result, 1e-9, True) in ("better", "worse"))
    assert np.mean(alarms) < most + chance(most, 500)


@pytest.mark.parametrize(("by_scene", "by_cell"), [(0.0, 1.0), (1.0, 0.3), (1.0, 1.0)])
def test_eight_scenes_find_an_effect_of_the_size_that_they_print(by_scene: float, by_cell: float) -> None:
    """One size for all: the root mean square of what they print, as their errors vary about the true one."""
    draw = np.random.default_rng(8).normal
    tables = [draw(0, by_scene, (8, 1)) + draw(0, by_cell, (8, 3)) for _ in range(500)]
    results = [over_scenes({str(place): row for place, row in enumerate(table)}) for table in tables]
    planted = float(np.mean([(one.smallest_detectable or 0.0) ** 2 for one in results])) ** 0.5
    found = [
        verdict(over_scenes({str(place): row + planted for place, row in enumerate(table)}), 1e-9, True) == "better"
        for table in tables
    ]
    assert np.mean(found) > 0.80 - chance(0.2, 500)


def test_scenes_are_the_units_where_there_are_several() -> None:
    """One seed each: nothing but scenes varies, and their mean is theirs."""
    result = over_scenes({"a": np.array([2.0]), "b": np.array([4.0]), "c": np.array([9.0])})
    alone = paired_difference(np.array([2.0, 4.0, 9.0]))
    assert (result.mean, result.units) == (alone.mean, 3)
    assert result.interval == pytest.approx(alone.interval, rel=0.1)


def test_seeds_are_the_units_of_a_single_scene() -> None:
    values = np.array([1.0, 3.0, 2.0])
    assert over_scenes({"a": values}) == paired_difference(values)
    assert over_scenes({"a": np.array([1.0, math.nan, 3.0, 2.0])}, 4) == paired_difference(values, 4)


def test_more_seeds_of_the_same_scenes_do_not_count_as_more_scenes() -> None:
    few = over_scenes({"a": np.array([1.0]), "b": np.array([4.0])})
    many = over_scenes({"a": np.full(50, 1.0), "b": np.full(50, 4.0)})
    assert many.interval == pytest.approx(few.interval, rel=0.05)
    assert few.units == many.units == 2
