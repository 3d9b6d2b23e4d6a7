"""Intervals, detectable effects and verdicts agree with closed forms and references."""

import math

import numpy as np
import pytest
from scipy.stats import nct, ttest_ind
from scipy.stats import t as student

from harness.verdicts import statistics
from harness.verdicts.estimates import nested
from harness.verdicts.statistics import PairedDifference, on_these_scenes, paired_difference, scenes_like_these


@pytest.mark.parametrize("family", [1, 8, 48, 1000])
@pytest.mark.parametrize("freedom", [1.0, 1.3, 2.0, 7.0, 23.0, 999.0])
def test_what_is_found_is_the_noncentral_t_distributions_tail(freedom: float, family: int) -> None:
    threshold = statistics.critical(freedom, family)
    shift = statistics.shift_found(threshold, freedom)
    assert nct.sf(threshold, freedom, shift) == pytest.approx(0.80, abs=1e-4)
    assert statistics.share_found(shift, threshold, freedom) == pytest.approx(statistics.POWER, abs=1e-6)
    for other in (0.3 * shift, 0.8 * shift, 1.5 * shift):
        exact = nct.sf(threshold, freedom, other)
        assert statistics.share_found(other, threshold, freedom) == pytest.approx(exact, abs=1e-4)


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
    shift = statistics.shift_found(statistics.critical(2, 8), 2)
    assert of_eight.smallest_detectable == pytest.approx(shift / math.sqrt(3))
    wider = paired_difference(10 * values)
    assert wider.smallest_detectable == pytest.approx(10 * (result.smallest_detectable or 0))
    normal = float(statistics.rounded_down(math.inf))
    assert statistics.shift_found(statistics.critical(normal), normal) == pytest.approx(1.959964 + 0.841621, rel=1e-3)
    alike = paired_difference(np.array([1.0, 1.0, 1.0]))
    assert alike.smallest_detectable == 0.0, "without any spread"
    assert paired_difference(np.array([5.0])) == PairedDifference(5.0, None, None, 1), "one unit"


@pytest.mark.parametrize("freedom", [1.0, 1e4, 1e6])
@pytest.mark.parametrize("family", [28, 20_000])
def test_the_power_is_a_number_for_any_shift_and_family(freedom: float, family: int) -> None:
    """Where libraries' noncentral t is NaN."""
    threshold = statistics.critical(freedom, family)
    assert statistics.share_found(1e6 * threshold, threshold, freedom) == pytest.approx(1.0)
    found = statistics.shift_found(threshold, freedom)
    assert statistics.share_found(found, threshold, freedom) == pytest.approx(statistics.POWER, abs=1e-4)


@pytest.mark.parametrize("values", [[], [1.0, math.nan], [math.inf], [1.0, -math.inf]])
def test_differences_that_are_not_numbers_are_refused(values: list[float]) -> None:
    with pytest.raises(ValueError, match="finite and not empty"):
        paired_difference(np.array(values))


def drawn() -> dict[str, np.ndarray]:
    """Return differences of eight scenes with three seeds each."""
    return {str(scene): row for scene, row in enumerate(np.random.default_rng(308).normal(size=(8, 3)))}


def test_on_these_scenes_of_equal_variances_is_the_pooled_t_interval() -> None:
    row = np.array([-1.0, 0.0, 1.0])
    result = on_these_scenes({"a": 5 + row, "b": 7 + row, "c": 3 + row})
    half = 2.446912 / 3  # error² = 1 / 9; t of 6 degrees of freedom
    assert (result.mean, result.freedom, result.units) == (5.0, 6.0, 3)
    assert result.interval == pytest.approx((5 - half, 5 + half), abs=1e-5)
    assert result.effect == pytest.approx(5.0)
    assert result.smallest_detectable == pytest.approx(statistics.shift_found(statistics.critical(6), 6) / 3)


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


def test_the_freedom_on_these_scenes_is_satterthwaites() -> None:
    """Three seeds of variance 1 and five of 400 have (1/3 + 80)² / ((1/3)² / 2 + 80² / 4) degrees of freedom."""
    three, five = np.array([-1.0, 0.0, 1.0]), 10.0 * np.array([-2.0, -2.0, 0.0, 2.0, 2.0])
    result = on_these_scenes({"a": three, "b": five, "c": np.full(5, math.nan)})
    assert result.error == pytest.approx(math.sqrt(1 / 3 + 80) / 2)
    expected = (1 / 3 + 80) ** 2 / ((1 / 3) ** 2 / 2 + 80**2 / 4)
    assert result.freedom == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("repeated", range(1, 8))
def test_a_scene_without_repeats_leaves_no_interval_on_these_scenes(repeated: int) -> None:
    """Regression test: seven scenes of one seed and one of two once gave ± 0.001 dB."""
    table = drawn()
    for scene in list(table)[repeated:]:
        table[scene][1:] = math.nan
    assert on_these_scenes(table).interval is None
    assert scenes_like_these(table).interval is not None


def test_a_scene_without_any_difference_is_no_part() -> None:
    table = drawn()
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
    np.testing.assert_array_equal(nested.medians(values), [2.0, 2.5, math.nan, 7.0])
