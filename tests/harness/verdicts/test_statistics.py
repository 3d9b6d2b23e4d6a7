"""Intervals, detectable effects and verdicts have their stated error rates in simulation."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import nct, ttest_ind
from scipy.stats import t as student

from harness.records.verdict import OPEN, Size, Verdict
from harness.verdicts import statistics
from harness.verdicts.estimates import nested
from harness.verdicts.statistics import PairedDifference, on_these_scenes, paired_difference, scenes_like_these, verdict

Table = dict[str, np.ndarray]

REPETITIONS = 4000
SMALLER: Size = "smaller than matters"


def chance(share: float, repetitions: int = REPETITIONS) -> float:
    """Return four standard errors of a share."""
    return 4 * math.sqrt(share * (1 - share) / repetitions)


def held(results: list[PairedDifference], truth: float = 0.0) -> float:
    pairs = [result.interval for result in results]
    return float(np.mean([pair is not None and pair[0] <= truth <= pair[1] for pair in pairs]))


@pytest.mark.parametrize("units", [3, 8])
def test_95_percent_of_intervals_hold_the_truth_and_5_percent_tell_nothing_from_nothing(units: int) -> None:
    draws = np.random.default_rng(1).normal(0.0, 1.0, (REPETITIONS, units))
    results = [paired_difference(row) for row in draws]
    assert held(results) == pytest.approx(0.95, abs=chance(0.05))
    signs = [verdict(result, 0.2).sign for result in results]
    false = np.mean([sign != "open" for sign in signs])
    assert 0.03 < false < 0.05 + chance(0.05)
    assert signs.count("above 0") == pytest.approx(signs.count("below 0"), abs=60)


@pytest.mark.parametrize("units", [2, 3, 8, 24])
@pytest.mark.parametrize("family", [1, 8, 48])
def test_the_difference_that_is_printed_for_the_true_spread_is_found_in_80_percent(units: int, family: int) -> None:
    """All repetitions share one effect, as the size that each of them prints varies."""
    planted = paired_difference(of_spread_1(units), family).smallest_detectable
    draws = np.random.default_rng(2).normal(planted, 1, (REPETITIONS, units))
    above = [verdict(paired_difference(row, family), 0.2).sign == "above 0" for row in draws]
    assert np.mean(above) == pytest.approx(0.80, abs=chance(0.2))


@pytest.mark.parametrize("family", [1, 8, 48, 1000])
@pytest.mark.parametrize("freedom", [1.0, 1.3, 2.0, 7.0, 23.0, 999.0])
def test_what_is_found_is_the_noncentral_t_distributions_tail(freedom: float, family: int) -> None:
    threshold = statistics.critical(freedom, family)
    shift = statistics.shift_found(threshold, freedom)
    assert nct.sf(threshold, freedom, shift) == pytest.approx(0.80, abs=1e-4)
    for other in (0.3 * shift, 0.8 * shift, 1.5 * shift):
        exact = nct.sf(threshold, freedom, other)
        assert statistics.share_found(other, threshold, freedom) == pytest.approx(exact, abs=1e-4)


def of_spread_1(units: int) -> np.ndarray:
    values = np.linspace(-1.0, 1.0, units)
    return values / values.std(ddof=1)


def test_the_interval_is_students() -> None:
    values = np.array([1.0, 2.0, 3.0])
    result, of_eight = paired_difference(values), paired_difference(values, 8)
    half = 4.302653 / math.sqrt(3)  # t of 2 degrees of freedom at 97.5 %
    assert (result.mean, result.units) == (2.0, 3)
    assert result.interval == result.simultaneous == of_eight.interval == pytest.approx((2 - half, 2 + half), rel=1e-6)
    half = 12.590 / math.sqrt(3)  # at 1 − 0.025 / 8
    assert of_eight.simultaneous == pytest.approx((2 - half, 2 + half), rel=1e-3)
    assert statistics.critical(2, 1) < statistics.critical(2, 2) < statistics.critical(2, 8)
    # noncentral by 5.653489, t is beyond 4.302653 in 80 %
    assert result.smallest_detectable == pytest.approx(5.653489 / math.sqrt(3), rel=1e-5)
    wider = paired_difference(10 * values)
    assert wider.smallest_detectable == pytest.approx(10 * (result.smallest_detectable or 0))
    many = np.random.default_rng(3).normal(0, 1, 100_000)
    of_normal = (1.959964 + 0.841621) * many.std(ddof=1) / math.sqrt(100_000)
    assert paired_difference(many).smallest_detectable == pytest.approx(of_normal, rel=1e-3)
    alike = paired_difference(np.array([1.0, 1.0, 1.0]))
    assert alike.smallest_detectable == 0.0, "without any spread"


def test_a_whole_family_holds_the_truth_in_95_percent() -> None:
    """Eight scenes of three seeds with one interval per scene are independent, so that Bonferroni is almost exact."""

    def misses(pair: tuple[float, float] | None) -> bool:
        return pair is None or pair[0] > 0 or pair[1] < 0

    draws = np.random.default_rng(4).normal(0, 1, (1000, 8, 3))
    tables = [[paired_difference(row, 8) for row in table] for table in draws]
    missed = np.mean([any(misses(result.simultaneous) for result in table) for table in tables])
    assert missed == pytest.approx(1 - (1 - 0.05 / 8) ** 8, abs=chance(0.05, 1000))
    # what would come of eight uncorrected looks
    assert np.mean([any(misses(result.interval) for result in table) for table in tables]) > 0.25


def test_one_unit_has_no_interval_and_no_verdict() -> None:
    result = paired_difference(np.array([5.0]))
    assert result == PairedDifference(5.0, None, None, 1)
    assert verdict(result, 0.2) == OPEN


@pytest.mark.parametrize("values", [[], [1.0, math.nan], [math.inf], [1.0, -math.inf]])
def test_differences_that_are_not_numbers_are_refused(values: list[float]) -> None:
    with pytest.raises(ValueError, match="finite and not empty"):
        paired_difference(np.array(values))


def test_a_verdict_is_taken_from_the_simultaneous_interval() -> None:
    """The interval of the single comparison does not count."""
    assert verdict(PairedDifference(0.0, (7.0, 8.0), None, 3, (-0.1, 0.1)), 0.2) == Verdict("open", SMALLER)


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
    few, many = ({"a": np.full(seeds, 1.0), "b": np.full(seeds, 4.0)} for seeds in (1, 50))
    assert scenes_like_these(many) == scenes_like_these(few), "more seeds do not count as more scenes"
    # one seed each knows nothing of seeds
    assert (on_these_scenes(few).interval, statistics.on_one_scene(few["a"]).interval) == (None, None)


def test_one_scene_alone_is_students_t() -> None:
    values = np.array([1.0, 3.0, 2.0])
    expected = paired_difference(values, 4)
    alone = statistics.on_one_scene(np.append(math.nan, values), 4)
    for found in (alone, on_these_scenes({"a": np.append(values, math.nan)}, 4)):
        assert found.interval == pytest.approx(expected.interval)
        assert found.simultaneous == pytest.approx(expected.simultaneous)
        assert (found.freedom, found.effect) == (2.0, pytest.approx(2.0))


@pytest.mark.parametrize("spread_of_scenes", [0.0, 2.0])
def test_intervals_hold_what_they_are_about(spread_of_scenes: float) -> None:
    tables = drawn(8, 3, spread_of_scenes, many=1000)
    assert held([scenes_like_these(table) for table in tables]) == pytest.approx(0.95, abs=0.02)
    # what is true on these scenes is what their infinitely many seeds would say: seeds drawn about 0 alone
    fixed = drawn(8, 3, 0.0, many=1000)
    assert held([on_these_scenes(table) for table in fixed]) == pytest.approx(0.95, abs=0.02)
    if spread_of_scenes:
        assert held([on_these_scenes(table) for table in tables]) < 0.6


@pytest.mark.parametrize("estimate", [on_these_scenes, scenes_like_these])
def test_eight_scenes_find_an_effect_of_the_size_that_they_print(estimate: Callable[[Table], PairedDifference]) -> None:
    """All tables share one effect, the root mean square of the printed sizes, as their errors vary."""
    tables = drawn(8, 3, 0.0, many=500)
    sizes = [estimate(table).smallest_detectable or 0.0 for table in tables]
    planted = float(np.sqrt(np.mean(np.square(sizes))))
    shifted = [{scene: row + planted for scene, row in table.items()} for table in tables]
    above = [verdict(estimate(table), 0.2).sign == "above 0" for table in shifted]
    assert np.mean(above) == pytest.approx(0.80, abs=chance(0.2, 500))


@pytest.mark.parametrize(("freedom", "family"), [(1.0, 200), (2.5, 9), (1e6, 1), (math.inf, 3)])
def test_what_can_be_detected_is_found_for_all_degrees_of_freedom(freedom: float, family: int) -> None:
    kept = float(statistics.rounded_down(freedom))
    threshold = statistics.critical(kept, family)
    shift = statistics.shift_found(threshold, kept)
    assert statistics.share_found(shift, threshold, kept) == pytest.approx(statistics.POWER, abs=1e-6)


def test_the_freedom_on_these_scenes_is_satterthwaites() -> None:
    """Three seeds of variance 1 and five of 4 have (1/3 + 4/5)² / ((1/3)² / 2 + (4/5)² / 4) degrees of freedom."""
    three, five = np.array([-1.0, 0.0, 1.0]), np.array([-2.0, -2.0, 0.0, 2.0, 2.0])
    result = on_these_scenes({"a": three, "b": five, "c": np.full(5, math.nan)})
    assert result.error == pytest.approx(math.sqrt(1 / 3 + 4 / 5) / 2)
    expected = (1 / 3 + 4 / 5) ** 2 / ((1 / 3) ** 2 / 2 + (4 / 5) ** 2 / 4)
    assert result.freedom == pytest.approx(expected, abs=0.1)


def test_one_noisy_scene_alone_decides_the_freedom() -> None:
    (table,) = drawn(8, 3, 0.0)
    table["3"] = 1000 * table["3"]
    assert on_these_scenes(table).freedom == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("repeated", range(1, 8))
def test_a_scene_without_repeats_leaves_no_interval_on_these_scenes(repeated: int) -> None:
    """Regression test: seven scenes of one seed and one of two once gave ± 0.001 dB."""
    (table,) = drawn(8, 3, 0.0)
    for scene in list(table)[repeated:]:
        table[scene][1:] = math.nan
    assert on_these_scenes(table).interval is None
    assert scenes_like_these(table).interval is not None


def test_a_scene_without_any_difference_is_no_part() -> None:
    (table,) = drawn(8, 3, 0.0)
    table["5"][:] = math.nan
    result = on_these_scenes(table)
    assert result.units == 7
    assert result.mean == pytest.approx(np.mean([row.mean() for scene, row in table.items() if scene != "5"]))
    for wrong in (lambda: statistics.on_one_scene(table["5"]), lambda: on_these_scenes({"5": table["5"]})):
        with pytest.raises(ValueError, match=r"no.* difference|not empty"):
            wrong()


def test_the_p_value_is_that_of_the_interval() -> None:
    """It is 5 % for a mean at the interval's end with any freedom, and many at once equal single ones."""
    values = np.random.default_rng(6).normal(0.5, 1.0, (200, 6, 3)) * np.linspace(0.2, 3.0, 6)[:, None]
    for name in ("on_these_scenes", "scenes_like_these"):
        many = getattr(nested, name)(values)
        p, halves = statistics.p_values(many), statistics.half_widths(many)
        assert ((p < 0.05) == (np.abs(many.mean) > halves)).all()
        for place in range(5):
            table = {str(scene): row for scene, row in enumerate(values[place])}
            one = {"on_these_scenes": on_these_scenes, "scenes_like_these": scenes_like_these}[name](table)
            assert one.p == pytest.approx(p[place])
    assert paired_difference(np.array([1.0, 2.0, 3.0])).p == pytest.approx(2 * student.sf(2 * 3**0.5, 2))
    assert paired_difference(np.array([1.0, 1.0])).p == 0.0
    assert paired_difference(np.array([0.0, 0.0])).p == 1.0


def test_a_change_of_independent_estimates_is_welchs() -> None:
    first, second = np.array([[1.0, 2.0, 4.0]]), np.array([[0.0, 5.0, 1.0, 2.0]])
    many = nested.less(nested.on_these_scenes(first), nested.on_these_scenes(second))
    welch = ttest_ind(first[0], second[0], equal_var=False)
    assert many.freedom == pytest.approx(welch.df)
    assert many.mean / many.error == pytest.approx(welch.statistic)


def test_medians_over_seeds_leave_out_what_is_missing() -> None:
    values = np.array([[3.0, 1.0, 2.0], [4.0, math.nan, 1.0], [math.nan] * 3, [7.0, math.nan, math.nan]])
    np.testing.assert_array_equal(nested.scene_medians(values), [2.0, 2.5, math.nan, 7.0])
