"""Figures of each method: failure rates, ratios of core seconds, and the gain of the last doubling of the steps."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.stats import binomtest

from harness.records.cells import CellRecord
from harness.verdicts.failures import exact_interval, failures
from harness.verdicts.last_doubling import gain_of_last_doubling, in_words, last_doublings
from harness.verdicts.training_cost import CostRatio, cost_ratios
from tests.harness.cells import cell, checkpoint, diverged


def done(method: str, seed: int, scene: str = "lego", collapsed: bool = False) -> CellRecord:
    warnings = ["empty collapse: mean test opacity 0.001"] if collapsed else ["billboard"]
    return cell(scene, method, seed, [checkpoint(10, 10.0, 20.0)], warnings=warnings)


@pytest.mark.parametrize(("failed", "runs"), [(0, 24), (1, 24), (5, 24), (24, 24), (3, 7)])
def test_the_interval_is_that_of_clopper_and_pearson(failed: int, runs: int) -> None:
    assert exact_interval(failed, runs) == pytest.approx(tuple(binomtest(failed, runs).proportion_ci(method="exact")))


def test_runs_are_counted_by_how_they_failed_and_other_ends_are_no_runs() -> None:
    cells = [done("nerf", seed) for seed in range(4)] + [done("qnerf", 0, collapsed=True), diverged("lego", "qnerf", 1)]
    cells += [done("qnerf", 2), replace(diverged("lego", "qnerf", 3), status="error")]
    result = failures(cells, ["nerf", "qnerf", "other"], [("qnerf", "nerf"), ("other", "nerf")])
    nerf, qnerf = result.rates
    assert (nerf.runs, nerf.failed, nerf.rate) == (4, 0, 0.0)
    assert (qnerf.runs, qnerf.diverged, qnerf.collapsed) == (3, 1, 1)
    (duel,) = result.comparisons
    assert (duel.pairs, duel.only_method, duel.only_against, duel.p_value) == (3, 2, 0, 1.0)
    assert (duel.difference, duel.verdict) == (pytest.approx(2 / 3), "open")


@pytest.mark.parametrize(("lost", "verdict"), [(5, "open"), (6, "above 0"), (24, "above 0")])
def test_pairs_decide_of_which_one_alone_failed(lost: int, verdict: str) -> None:
    """The chance of six of six is 2 · 2⁻⁶ = 3 %, of five of five 6 %; pairs that failed alike do not count."""
    keys = [(scene, seed) for scene in "abcdefgh" for seed in range(3)]
    cells = [done("nerf", seed, scene) for scene, seed in keys]
    cells += [done("qnerf", seed, scene, place < lost) for place, (scene, seed) in enumerate(keys)]
    both = [done(method, 9, "a", collapsed=True) for method in ("nerf", "qnerf")]
    (duel,) = failures([*cells, *both], ["nerf", "qnerf"], [("qnerf", "nerf")]).comparisons
    assert (duel.p_value, duel.verdict) == (pytest.approx(2 * 0.5**lost), verdict)
    family = failures([*cells, *both], ["nerf", "qnerf"], [("qnerf", "nerf"), ("another", "nerf")]).comparisons
    assert family[0].p_value == pytest.approx(4 * 0.5**lost), "pairs of methods are judged together"
    (other,) = failures(cells, ["nerf", "qnerf"], [("nerf", "qnerf")]).comparisons
    assert other.verdict == ("below 0" if verdict == "above 0" else verdict)


# ratios of core seconds to the baseline's, and cells that shared their processor


def took(scene: str, method: str, seed: int, seconds: float, steps: int = 100, **changes: float | None) -> CellRecord:
    return cell(scene, method, seed, [checkpoint(steps, 2 * seconds, 20.0)], train_core_seconds=seconds, **changes)


def test_the_ratio_is_the_geometric_mean_over_pairs_of_core_seconds() -> None:
    factors = {("lego", 0): 1.5, ("lego", 1): 1.2, ("chair", 0): 1.1, ("chair", 1): 1.3}
    cells = [took(scene, "nerf", seed, 8.0) for scene in ("lego", "chair") for seed in (0, 1)]
    cells += [took(scene, "qnerf", seed, 8.0 * factor) for (scene, seed), factor in factors.items()]
    baseline, ratio = cost_ratios(cells, ["nerf", "qnerf"], "nerf")
    assert baseline == CostRatio("nerf", None, None)
    mean = np.exp(np.mean(np.log(list(factors.values()))))
    assert ratio.ratio == pytest.approx(mean)
    assert ratio.interval[0] < mean < ratio.interval[1]
    assert np.sqrt(np.prod(ratio.interval)) == pytest.approx(mean), "the interval is one of logarithms"


def test_pairs_of_other_steps_and_without_an_end_are_left_out() -> None:
    kept = [took("lego", "nerf", 0, 8.0), took("lego", "qnerf", 0, 16.0)]
    beside = [took("lego", "nerf", 1, 8.0), took("lego", "qnerf", 1, 4.0, steps=50)]
    beside += [took("lego", "nerf", 2, 8.0), diverged("lego", "qnerf", 2)]
    assert cost_ratios([*kept, *beside], ["nerf", "qnerf"], "nerf")[1].ratio == pytest.approx(2.0)
    assert cost_ratios(beside, ["nerf", "qnerf"], "nerf")[1] == CostRatio("qnerf", None, None)


def test_the_wall_is_taken_where_no_core_seconds_were_counted() -> None:
    older = [replace(took("lego", name, 0, seconds), train_core_seconds=None) for name, seconds in (("a", 1), ("b", 3))]
    assert cost_ratios([older[0], older[1]], ["a", "b"], "a")[1].ratio == pytest.approx(3.0)


def test_a_cell_that_shared_its_processor_is_told_from_one_that_used_several() -> None:
    alone = took("lego", "nerf", 0, 8.0)
    assert alone.wall_per_core_second == 2.0
    assert alone.waited
    assert not replace(alone, train_core_seconds=15.0).waited
    assert not replace(alone, train_core_seconds=32.0).waited, "two threads"
    passive = replace(alone, train_core_seconds=15.0, provenance={"threads": 2, "waiting": "passive"})
    assert not passive.waited, "its threads slept"
    assert not passive.spun
    active = replace(passive, provenance={"threads": 2, "waiting": "active"})
    assert active.spun, "2 × 16 s on cores of which it had 15 s"
    assert active.waited
    assert active.all_warnings == ["core seconds too long: 2 threads waited actively"]
    assert replace(active, provenance={"threads": 2}).spun, "an older record: they waited actively"
    assert not replace(active, train_core_seconds=30.0).spun, "nothing else ran"
    assert not replace(active, train_core_seconds=8.0, provenance={"threads": 1}).spun, "alone, it waits for nobody"
    assert not replace(alone, train_core_seconds=None).waited
    assert not replace(alone, provenance={"device": "NVIDIA H100"}).waited, "a GPU's work is no processor's"


# the last doubling


def rising(slope: float, scene: str = "lego", method: str = "nerf", seed: int = 0) -> CellRecord:
    """Return a cell that gains `slope` dB per doubling, without a checkpoint at half of its steps."""
    curve = [checkpoint(step, 0.01 * step, 20.0 + slope * math.log2(step)) for step in (10, 70, 300, 1000)]
    return cell(scene, method, seed, curve)


@pytest.mark.parametrize("slope", [-0.5, 0.0, 0.9])
def test_a_line_in_log_steps_gains_its_slope(slope: float) -> None:
    assert gain_of_last_doubling(rising(slope)) == pytest.approx(slope, abs=1e-12)


def test_only_what_lies_between_half_and_end_counts() -> None:
    curve = [checkpoint(1, 1.0, 5.0), checkpoint(50, 2.0, 20.0), checkpoint(100, 3.0, 20.75)]
    assert gain_of_last_doubling(cell("lego", "nerf", 0, curve)) == 0.75


def test_what_is_not_known_is_none() -> None:
    late = cell("lego", "nerf", 0, [checkpoint(51, 1.0, 20.0), checkpoint(100, 2.0, 21.0)])
    assert gain_of_last_doubling(late) is None, "no checkpoint at or below half"
    identical = cell("lego", "nerf", 0, [checkpoint(50, 1.0, 20.0), checkpoint(100, 2.0, None)])
    assert gain_of_last_doubling(identical) is None, "an end without a score"
    assert gain_of_last_doubling(cell("lego", "nerf", 0, [])) is None
    assert gain_of_last_doubling(diverged("lego", "nerf", 0)) is None
    empty = replace(rising(1.0), warnings=["empty collapse: mean test opacity 0.001"])
    assert gain_of_last_doubling(empty) is None


def test_means_are_over_scenes_of_the_means_over_seeds_with_t_over_scenes() -> None:
    slopes = {("a", 0): 1.0, ("a", 1): 2.0, ("b", 0): 0.5}
    cells = [rising(slope, scene, "nerf", seed) for (scene, seed), slope in slopes.items()]
    nerf, qnerf = last_doublings([*cells, diverged("b", "nerf", 1), diverged("a", "qnerf", 0)], ["nerf", "qnerf"])
    # scenes 1.5 and 0.5: mean 1, standard error 0.5, t of one degree of freedom 12.7062
    assert (nerf.method, nerf.cells) == ("nerf", 3)
    assert nerf.gain == pytest.approx(1.0)
    assert nerf.interval == pytest.approx((1 - 0.5 * 12.7062, 1 + 0.5 * 12.7062), abs=1e-4)
    assert (qnerf.gain, qnerf.interval, qnerf.cells) == (None, None, 0)
    assert in_words(nerf) == "nerf: +1.00 dB [−5.35, +7.35] in its last doubling; still rising"
    assert in_words(qnerf) == "qnerf: what its last doubling brought is not known"
    (one,) = last_doublings([rising(0.29)], ["nerf"])
    assert in_words(one) == "nerf: +0.29 dB in its last doubling"
