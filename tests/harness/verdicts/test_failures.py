"""Failure rates agree with exact sums; paired comparisons of failures."""

import pytest
from msgspec.structs import replace
from scipy.stats import binom

from harness.records.cells import CellRecord
from harness.verdicts.failures import exact_interval, failure_of, failures
from tests.harness.cells import cell, checkpoint, diverged


def done(method: str, seed: int, scene: str = "lego", collapsed: bool = False) -> CellRecord:
    warnings = ["empty collapse: mean test opacity 0.001"] if collapsed else ["billboard"]
    return cell(scene, method, seed, [checkpoint(10, 10.0, 20.0)], warnings=warnings)


def test_what_a_failure_is() -> None:
    assert failure_of(done("nerf", 0)) is None
    assert failure_of(done("nerf", 0, collapsed=True)) == "empty collapse"
    assert failure_of(diverged("lego", "nerf", 0)) == "diverged"
    assert failure_of(replace(diverged("lego", "nerf", 0), status="error")) is None


@pytest.mark.parametrize(("failed", "runs"), [(0, 24), (1, 24), (5, 24), (24, 24), (3, 7)])
def test_the_interval_ends_where_a_tail_has_2_5_per_cent(failed: int, runs: int) -> None:
    low, high = exact_interval(failed, runs)
    assert low == 0 if failed == 0 else binom.sf(failed - 1, runs, low) == pytest.approx(0.025)
    assert high == 1 if failed == runs else binom.cdf(failed, runs, high) == pytest.approx(0.025)


def test_the_interval_holds_the_truth_in_95_per_cent_at_least() -> None:
    intervals = [exact_interval(failed, 24) for failed in range(25)]
    for truth in (0.01, 0.02, 0.1, 0.5, 0.9):
        inside = sum(
            binom.pmf(failed, 24, truth) for failed, (low, high) in enumerate(intervals) if low <= truth <= high
        )
        assert inside >= 0.95


def test_runs_are_counted_by_how_they_failed_and_other_ends_are_no_runs() -> None:
    cells = [done("nerf", seed) for seed in range(4)] + [done("qnerf", 0, collapsed=True), diverged("lego", "qnerf", 1)]
    cells += [done("qnerf", 2), replace(diverged("lego", "qnerf", 3), status="error")]
    result = failures(cells, ["nerf", "qnerf", "other"], [("qnerf", "nerf"), ("other", "nerf")])
    nerf, qnerf = result.rates
    assert (nerf.runs, nerf.failed, nerf.rate) == (4, 0, 0.0)
    assert (qnerf.runs, qnerf.diverged, qnerf.collapsed) == (3, 1, 1)
    (duel,) = result.comparisons
    assert (duel.pairs, duel.only_method, duel.only_against, duel.p_value) == (3, 2, 0, 0.5)
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
    (other,) = failures(cells, ["nerf", "qnerf"], [("nerf", "qnerf")]).comparisons
    assert other.verdict == ("below 0" if verdict == "above 0" else verdict)
