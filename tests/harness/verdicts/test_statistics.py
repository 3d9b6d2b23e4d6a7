"""Intervals, detectable effects and verdicts, held to what they promise by simulation."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import nct

from harness.verdicts.nested import moderated
from harness.verdicts.statistics import (
    POWER,
    PairedDifference,
    critical,
    detectable,
    on_one_scene,
    on_these_scenes,
    paired_difference,
    rounded_down,
    scenes_like_these,
    share_found,
    shift_found,
    verdict,
)

Table = dict[str, np.ndarray]

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


def drawn(scenes: int, seeds: int, spread_of_scenes: float, spread: float = 1.0, many: int = 1) -> list[Table]:
    draw = np.random.default_rng(scenes + 100 * seeds).normal
    values = draw(0, spread_of_scenes, (many, scenes, 1)) + draw(0, spread, (many, scenes, seeds))
    return [{str(place): row for place, row in enumerate(table)} for table in values]


def test_on_these_scenes_of_equal_variances_is_the_pooled_t_interval() -> None:
    row = np.array([-1.0, 0.0, 1.0])
    result = on_these_scenes({"a": 5 + row, "b": 7 + row, "c": 3 + row})
    half = 2.446912 / 3  # error² = 1 / 9; t of 6 degrees of freedom
    assert (result.mean, result.freedom, result.units) == (5.0, 6.0, 3)
    assert result.interval == pytest.approx((5 - half, 5 + half), abs=1e-5)
    assert result.effect == pytest.approx(5.0)


def test_scenes_like_these_are_students_t_over_their_means() -> None:
    table = {"a": np.array([1.0, 3.0]), "b": np.array([4.0, math.nan]), "c": np.array([9.0, 9.0])}
    assert scenes_like_these(table, 3) == paired_difference(np.array([2.0, 4.0, 9.0]), 3)
    assert scenes_like_these({"a": np.array([1.0, 2.0])}).interval is None


def test_one_scene_alone_is_students_t() -> None:
    values = np.array([1.0, 3.0, 2.0])
    expected = paired_difference(values, 4)
    for result in (on_one_scene({"a": values}, "a", 4), on_these_scenes({"a": np.append(values, math.nan)}, 4)):
        assert result.interval == pytest.approx(expected.interval)
        assert result.simultaneous == pytest.approx(expected.simultaneous)
        assert (result.freedom, result.effect) == (2.0, pytest.approx(2.0))


def test_equal_scenes_lend_each_other_all_that_they_know() -> None:
    (table,) = drawn(8, 3, 2.0)
    scaled = {scene: values.mean() + (values - values.mean()) / values.std(ddof=1) for scene, values in table.items()}
    result = on_one_scene(scaled, "3")
    assert (result.freedom, result.error) == (16.0, pytest.approx(1 / 3**0.5))
    # critical values of 2.12 and not of 4.30, and where eight are looked at together of 3.17 and not of 12.6
    assert critical(16.0, 8) / critical(2.0, 8) == pytest.approx(0.25, abs=0.01)


def test_scenes_that_differ_keep_their_own_variance() -> None:
    """Many seeds and spreads of 1 and 100: nothing is borrowed."""
    draw = np.random.default_rng(3).normal
    table = {str(place): draw(0, 10.0 ** (2 * (place % 2)), 50) for place in range(8)}
    for scene, values in table.items():
        result = on_one_scene(table, scene)
        assert result.error == pytest.approx(values.std(ddof=1) / 50**0.5, rel=0.05)
        assert result.freedom == pytest.approx(50.0, abs=2.0)


def test_the_moderated_variance_is_that_of_smyth() -> None:
    """Drawn from the prior, its parameters are found again: 6 degrees of freedom about a variance of 2."""
    generator = np.random.default_rng(4)
    true = 6 * 2.0 / generator.chisquare(6, 40_000)
    variances = true * generator.chisquare(2, 40_000) / 2
    posterior, freedom = moderated(variances, np.full(40_000, 2.0))
    assert freedom[0] == pytest.approx(8.0, rel=0.05)
    np.testing.assert_allclose(posterior, (6 * 2.0 + 2 * variances) / 8, rtol=0.05)


def test_a_scene_with_one_difference_borrows_and_one_without_any_is_no_part() -> None:
    (table,) = drawn(8, 3, 0.0)
    table["2"][1:] = math.nan
    lone = on_one_scene(table, "2")
    assert (lone.units, lone.freedom) == (1, 14.0)
    assert lone.interval is not None
    table["5"][:] = math.nan
    result = on_these_scenes(table)
    assert result.units == 7
    assert result.mean == pytest.approx(np.mean([np.nanmean(row) for scene, row in table.items() if scene != "5"]))
    for wrong in (lambda: on_one_scene(table, "5"), lambda: on_these_scenes({"5": table["5"]})):
        with pytest.raises(ValueError, match=r"no.* difference"):
            wrong()


def test_one_seed_each_knows_nothing_of_seeds_and_something_of_scenes() -> None:
    table = {"a": np.array([2.0]), "b": np.array([4.0]), "c": np.array([9.0])}
    assert (on_these_scenes(table).interval, on_one_scene(table, "a").interval) == (None, None)
    assert scenes_like_these(table).interval is not None


def held(results: list[PairedDifference], truth: float = 0.0) -> float:
    return float(np.mean([one.interval is not None and one.interval[0] <= truth <= one.interval[1] for one in results]))


@pytest.mark.parametrize("spread_of_scenes", [0.0, 2.0])
def test_intervals_hold_what_they_are_about(spread_of_scenes: float) -> None:
    tables = drawn(8, 3, spread_of_scenes, many=1000)
    assert held([scenes_like_these(table) for table in tables]) == pytest.approx(0.95, abs=0.02)
    # what is true on these scenes is what their infinitely many seeds would say: seeds drawn about 0 alone
    fixed = drawn(8, 3, 0.0, many=1000)
    assert held([on_these_scenes(table) for table in fixed]) == pytest.approx(0.95, abs=0.02)
    if spread_of_scenes:
        assert held([on_these_scenes(table) for table in tables]) < 0.6


def test_more_seeds_of_the_same_scenes_do_not_count_as_more_scenes() -> None:
    few = scenes_like_these({"a": np.array([1.0]), "b": np.array([4.0])})
    many = scenes_like_these({"a": np.full(50, 1.0), "b": np.full(50, 4.0)})
    assert many == few


@pytest.mark.parametrize("estimate", [on_these_scenes, scenes_like_these])
def test_eight_scenes_find_an_effect_of_the_size_that_they_print(estimate: Callable[[Table], PairedDifference]) -> None:
    """One size for all: the root mean square of what they print, as their errors vary about the true one."""
    tables = drawn(8, 3, 0.0, many=500)
    sizes = [estimate(table).smallest_detectable or 0.0 for table in tables]
    planted = float(np.sqrt(np.mean(np.square(sizes))))
    shifted = [{scene: row + planted for scene, row in table.items()} for table in tables]
    found = [verdict(estimate(table), 1e-9, True) == "better" for table in shifted]
    assert np.mean(found) == pytest.approx(0.80, abs=chance(0.2, 500))


@pytest.mark.parametrize(("freedom", "family"), [(1.0, 200), (2.5, 9), (1e6, 1), (math.inf, 3)])
def test_what_can_be_detected_is_found_for_all_degrees_of_freedom(freedom: float, family: int) -> None:
    kept = rounded_down(freedom)
    threshold = critical(kept, family)
    shift = shift_found(threshold, kept)
    assert share_found(shift, threshold, kept) == pytest.approx(POWER, abs=1e-6)


def test_one_difference_a_scene_moderated_by_others_has_an_interval_or_none() -> None:
    """A scene of a single seed borrows its variance; where next to nothing is known of it there is no interval."""
    generator = np.random.default_rng(5)
    for _ in range(300):
        scales = 10.0 ** generator.uniform(-4, 4, 3)
        table = {str(place): scale * generator.normal(size=3) for place, scale in enumerate(scales)}
        table["0"][1:] = np.nan
        found = on_one_scene(table, "0")
        assert found.interval is None or found.freedom >= 1.0
