"""Robust estimates agree with slow references, and their error rates hold in simulation."""

import math

import numpy as np
import pytest
from scipy.stats import wilcoxon

from harness.verdicts.estimates.robust import hodges_lehmann, outliers, robust_over_scenes


@pytest.mark.parametrize("count", [6, 7, 8, 11])
def test_the_interval_holds_what_wilcoxons_exact_test_does_not_reject(count: int) -> None:
    values = np.random.default_rng(count).normal(0.3, 1.0, count)
    middle, low, high = hodges_lehmann(values)
    assert low < middle < high
    for end, inside in ((low, 1e-6), (high, -1e-6)):
        assert wilcoxon(values - end - inside, method="exact").pvalue > 0.05
        assert wilcoxon(values - end + inside, method="exact").pvalue <= 0.05


def test_the_estimate_is_the_median_of_the_means_of_all_pairs() -> None:
    values = np.array([1.0, 2.0, 4.0, 8.0])
    means = [(a + b) / 2 for place, a in enumerate(values) for b in values[place:]]
    assert hodges_lehmann(values)[0] == pytest.approx(float(np.median(means)))
    assert np.isnan(hodges_lehmann(np.arange(5.0))[1:]).all(), "five signs agree by chance in 6.25 %"
    with pytest.raises(ValueError, match="no unit"):
        hodges_lehmann(np.empty(0))


def test_many_tables_at_once_are_what_one_is_and_bad_cells_do_not_matter() -> None:
    values = np.random.default_rng(0).normal(0.2, 0.1, (50, 8, 3))
    values[:, 4, :] = math.nan
    many = robust_over_scenes(values)
    bad = values.copy()
    bad[:, 0, 0] = -100.0
    for place in range(50):
        one = robust_over_scenes(values[place])
        assert [float(part) for part in one] == pytest.approx([float(part[place]) for part in many])
        assert abs(float(robust_over_scenes(bad[place])[0]) - float(one[0])) < 0.1
    other = values.copy()
    other[3, 0] = math.nan
    with pytest.raises(ValueError, match="lack different scenes"):
        robust_over_scenes(other)


def test_a_cell_far_from_all_others_is_an_outlier_and_a_scene_that_differs_is_not() -> None:
    generator = np.random.default_rng(1)
    table = {str(scene): generator.normal(0.3 * (scene == 7), 0.1, 3) for scene in range(8)}
    assert outliers(table, 0.2) == []
    table["2"][1] -= 3.0
    table["4"][0] = math.nan
    assert outliers(table, 0.2) == [("2", 1)]
    assert outliers(table, 5.0) == [], "no more than the margin"
    assert outliers({"a": np.array([0.0, 0.0, 0.0, 0.1, 9.0])}, 0.2) == [], "five differences tell no outlier"
    assert outliers({}, 0.2) == []


def test_normal_differences_have_no_outlier() -> None:
    draws = np.random.default_rng(2).normal(0.0, 1.0, (500, 8, 3))
    found = sum(bool(outliers({str(scene): row for scene, row in enumerate(table)}, 0.0)) for table in draws)
    assert found <= 5
