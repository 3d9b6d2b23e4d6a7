"""Verdicts from figures and intervals, and their error rate in simulated studies with a known truth."""

import numpy as np
import pytest

from harness.verdicts.statistics import on_one_scene, on_these_scenes
from reports.claims.ledger import half_unit, judge_all, judge_figures, judge_gain, judge_level, seeds_that_settle

PAIR_SD = 0.248
"""The published standard deviation in dB of a paired difference about the true difference of its scene."""
STUDIES = 400


def test_rounding_of_printed_numbers():
    printed = {(1.4, ""): 0.05, (0.006, ""): 0.0005, (257, ""): 0.5, (67_000, ""): 500, (1_370_000, ""): 5000}
    printed |= {(18, "%"): 0.5, (20, "%"): 0.5, (33.0, "dB"): 0.05, (4.2, "h"): 0.05}
    assert {number: half_unit(*number) for number in printed} == pytest.approx(printed)


@pytest.mark.parametrize(
    ("printed", "margin", "measured", "at_scale", "elsewhere"),
    [
        (1.5, 0.2, (1.31, 1.69), "reproduced", "seen"),
        (1.5, 0.2, (1.29, 1.6), "inconclusive", "seen"),
        (1.5, 0.2, (0.1, 3.0), "inconclusive", "seen"),
        (1.5, 0.2, (-0.1, 3.0), "inconclusive", "inconclusive"),
        (1.5, 0.2, (0.2, 1.29), "not reproduced", "not seen at this scale"),
        (1.5, 0.2, (1.71, 3.0), "not reproduced", "not seen at this scale"),
        (1.5, 0.2, (9.9, 10.1), "not reproduced", "not seen at this scale"),
        (1.5, 0.2, (-5.0, -0.1), "not reproduced", "not seen at this scale"),
        (1.5, 0.2, None, "inconclusive", "inconclusive"),
        # a gain that is smaller than its margin still has a sign
        (0.002, 0.005, (-0.002, -0.001), "not reproduced", "not seen at this scale"),
        (0.002, 0.005, (-0.002, 0.001), "inconclusive", "inconclusive"),
        (0.002, 0.005, (0.001, 0.004), "reproduced", "seen"),
        # so has a loss, such as a smaller error
        (-0.003, 0.005, (0.0005, 0.0015), "not reproduced", "not seen at this scale"),
        (-0.003, 0.005, (-0.004, 0.001), "inconclusive", "inconclusive"),
        (-0.003, 0.005, (-0.004, -0.001), "reproduced", "seen"),
        (-0.5, 0.2, (-5.0, 5.0), "inconclusive", "inconclusive"),
    ],
)
def test_a_printed_gain_against_an_interval(printed, margin, measured, at_scale, elsewhere):
    assert judge_gain(printed, margin, measured, True) == at_scale
    assert judge_gain(printed, margin, measured, False) == elsewhere


@pytest.mark.parametrize(("printed", "bound"), [(0.1, "at most"), (-0.2, "at least"), (0.0, "at least")])
def test_at_another_scale_a_bound_that_includes_0_is_seen_only_where_the_interval_keeps_it(printed, bound):
    inside = (printed - 0.02, printed - 0.01) if bound == "at most" else (printed + 0.01, printed + 0.02)
    assert judge_gain(printed, 0.2, inside, False, bound) == "seen"
    assert judge_gain(printed, 0.2, (-5.0, 5.0), False, bound) == "inconclusive"


@pytest.mark.parametrize(
    ("printed", "bound", "measured", "verdict"),
    [
        (1.5, "at least", (1.5, 1.6), "reproduced"),
        (1.5, "at least", (1.4, 1.6), "inconclusive"),
        (1.5, "at least", (0.1, 1.49), "not reproduced"),
        (1.5, "at most", (-9.0, 1.4), "reproduced"),
        (1.5, "at most", (1.6, 1.7), "not reproduced"),
        # a loss, such as a smaller error, need not lie above 0
        (-0.05, "at most", (-0.08, -0.06), "reproduced"),
        (-0.05, "", (-0.052, -0.049), "reproduced"),
        ((1.2, 1.8), "", (1.1, 1.9), "reproduced"),
        ((1.2, 1.8), "", (2.1, 2.2), "not reproduced"),
    ],
)
def test_bounds_losses_and_ranges(printed, bound, measured, verdict):
    assert judge_gain(printed, 0.2 if printed != -0.05 else 0.005, measured, True, bound) == verdict
    if bound:
        assert judge_level(printed, 0.2, measured, bound) == verdict


def test_a_printed_level_is_judged_on_both_sides_and_one_part_refutes_a_statement():
    verdicts = {
        (32.9, 33.1): "reproduced", (32.7, 33.1): "inconclusive", (31.0, 32.7): "not reproduced",
        (33.3, 35.0): "not reproduced", None: "inconclusive",
    }  # fmt: skip
    assert {pair: judge_level(33.0, 0.2, pair) for pair in verdicts} == verdicts
    assert judge_all(["reproduced", "reproduced"]) == "reproduced"
    assert judge_all(["reproduced", "inconclusive"]) == "inconclusive"
    assert judge_all(["reproduced", "inconclusive", "not reproduced"]) == "not reproduced"


@pytest.mark.parametrize(
    ("printed", "rounding", "computed", "reachable", "verdict"),
    [
        (18.0, 0.5, 18.0, (17.5, 18.4), "reproduced"),
        (18.0, 0.5, 18.5, (18.4, 18.6), "reproduced"),
        (18.0, 0.5, 19.05, (16.9, 21.2), "inconclusive"),
        (18.0, 0.5, 19.05, (18.6, 19.5), "not reproduced"),
        (18.0, 0.5, 16.0, (15.0, 17.4), "not reproduced"),
        # half a digit in binary fractions is still half a digit
        (1.5, 0.05, 1.45, (1.45, 1.45), "reproduced"),
        (32.5, 0.05, 32.449, (32.449, 32.449), "not reproduced"),
    ],
)
def test_a_printed_result_against_its_figures(printed, rounding, computed, reachable, verdict):
    assert judge_figures(printed, rounding, computed, reachable) == verdict


@pytest.mark.parametrize(("scenes", "family"), [(8, 1), (1, 8), (1, 1)])
def test_the_seeds_that_settle_a_gain_do_so_in_four_of_five_studies(scenes, family):
    seeds = seeds_that_settle(PAIR_SD, scenes, 0.2, family)
    generator = np.random.default_rng(3)

    def share(many: int) -> float:
        tables = generator.normal(1.5, PAIR_SD, (STUDIES, scenes, many))
        results = [
            on_one_scene(table[0], family)
            if scenes == 1
            else on_these_scenes(dict(zip("abcdefgh", table, strict=True)))
            for table in tables
        ]
        verdicts = [judge_gain(1.5, 0.2, result.simultaneous, True) for result in results]
        return verdicts.count("reproduced") / STUDIES

    assert share(seeds) >= 0.76
    assert seeds == 3 or share(seeds // 2) < 0.76
    assert seeds_that_settle(100.0, 1, 0.2) is None
