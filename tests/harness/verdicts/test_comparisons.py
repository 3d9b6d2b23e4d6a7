"""Comparisons of hand-written cells have literal differences."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from harness.records.cells import CellRecord, Comparison, empty_cell
from harness.records.metric_table import METRICS
from harness.records.verdict import OPEN, Verdict
from harness.verdicts import comparisons
from harness.verdicts.comparisons import budgets_of, compare, differences, judged, keyed
from harness.verdicts.statistics import LEVEL, critical, scenes_like_these
from tests.harness.cells import cell, checkpoint, diverged, with_core_seconds

DUEL = ["nerf", "qnerf"]


def of(rows: list[Comparison], **wanted: object) -> Comparison:
    """Return the only row with these values."""
    (row,) = [row for row in rows if all(getattr(row, name) == value for name, value in wanted.items())]
    return row


def slow(method: str, seed: int, last: float, scene: str = "lego") -> CellRecord:
    """Return a cell that is scored after 20 and 200 seconds."""
    return cell(scene, method, seed, [checkpoint(10, 20.0, last - 6), checkpoint(100, 200.0, last)])


def quick(method: str, seed: int, last: float, scene: str = "lego") -> CellRecord:
    """Return a cell that is scored after 10 and 100 seconds."""
    return cell(scene, method, seed, [checkpoint(10, 10.0, last - 4), checkpoint(100, 100.0, last)])


def test_equal_steps_compare_final_scores_and_equal_time_reads_the_slower_where_the_quicker_ended() -> None:
    cells = [quick("nerf", 0, 24.0), quick("nerf", 1, 25.0), slow("qnerf", 0, 27.0), slow("qnerf", 1, 26.0)]
    row = psnr_row(cells, "lego")
    assert (row.method, row.against, row.pairs, row.unpaired) == ("qnerf", "nerf", 2, 0)
    assert (row.difference, row.verdict) == (2.0, OPEN)
    # differences 3 and 1: mean 2, standard error 1, t of one degree of freedom 12.7062
    assert row.interval == pytest.approx((2 - 12.7062, 2 + 12.7062), abs=1e-4)
    row = psnr_row(cells[::2], "lego", "seconds")
    # qnerf after 100 s lies log(100 / 20) / log(200 / 20) of the way from 21 to 27 dB
    assert row.difference == pytest.approx(21 + 6 * math.log(5) / math.log(10) - 24)
    assert (row.interval, row.verdict, row.smallest_detectable) == (None, OPEN, None)
    many = [quick("nerf", seed, 26.0 + 0.01 * seed) for seed in range(5)] + [slow("qnerf", s, 27.0) for s in range(5)]
    assert psnr_row(many, "lego").verdict.sign == "above 0"
    assert psnr_row(many, "lego", "seconds").verdict.sign == "below 0", "who wins may differ"


def test_equal_core_seconds_are_read_where_the_one_that_spent_less_ended() -> None:
    cells = [with_core_seconds(quick("nerf", 0, 24.0), 4.0), with_core_seconds(slow("qnerf", 0, 27.0), 1.0)]
    rows = compare(cells, DUEL)
    # nerf after 200 core seconds lies log(200 / 40) / log(400 / 40) of the way from 20 to 24 dB
    at_200 = 20 + 4 * math.log(5) / math.log(10)
    found = of(rows, scene="lego", metric="psnr", budget="core_seconds")
    assert found.difference == pytest.approx(27 - at_200)
    along = {name for name in METRICS if getattr(cells[0].curve[0], name) is not None}
    assert {row.metric for row in rows if row.budget == "core_seconds"} == along < set(METRICS)


def test_where_a_run_has_not_counted_core_seconds_there_is_no_such_comparison() -> None:
    cells = [with_core_seconds(quick("nerf", 0, 24.0), 1.0), slow("qnerf", 0, 27.0)]
    assert budgets_of(cells) == ("steps", "seconds")
    assert {row.budget for row in compare(cells, DUEL)} == {"steps", "seconds"}
    assert differences(*keyed(cells), "qnerf", "nerf", "psnr", "core_seconds") == {
        "lego": pytest.approx([math.nan], nan_ok=True)
    }
    never = empty_cell("lego", "qnerf", 0, "error", "disk full")
    assert "core_seconds" in budgets_of([cells[0], never]), "one that never trained has none to count"


def test_a_sign_is_that_of_the_difference() -> None:
    flips = {"nerf": (0.300, 0.301, 0.301, 0.301, 0.302), "qnerf": (0.2,) * 5}
    cells = [
        cell("lego", method, seed, [checkpoint(10, 10.0, 20.0)], scores={"psnr": 20.0, "flip": flip})
        for method, row in flips.items()
        for seed, flip in enumerate(row)
    ]
    row = of(compare(cells, DUEL), scene="lego", metric="flip", budget="steps")
    assert row.difference == pytest.approx(-0.101)
    assert row.verdict == Verdict("below 0", "matters"), "the sign of the difference, whichever way is better"


def planted(gains: dict[str, list[float]]) -> list[CellRecord]:
    """Return cells of nerf at 20 dB, and of qnerf above it by `gains`, scene → gain by seed."""
    cells = [quick("nerf", seed, 20.0, scene) for scene, row in gains.items() for seed in range(len(row))]
    return cells + [
        quick("qnerf", seed, 20.0 + gain, scene) for scene, row in gains.items() for seed, gain in enumerate(row)
    ]


def psnr_row(cells: list[CellRecord], scene: str, budget: str = "steps") -> Comparison:
    return of(compare(cells, DUEL), scene=scene, metric="psnr", budget=budget)


def test_a_verdict_is_taken_from_the_interval_of_the_family_to_which_no_scene_lends_its_variance() -> None:
    """0.8 dB is 3.6 standard errors with 4 degrees of freedom; a scene needs 2.8, one of eight needs 5.3."""
    gains = {scene: [0.3, 0.3, 0.8, 1.3, 1.3] for scene in "abcdefgh"}
    alone, of_eight = psnr_row(planted({"a": gains["a"]}), "a"), psnr_row(planted(gains), "a")
    assert alone.verdict.sign == "above 0"
    assert (of_eight.interval[0] > 0 > of_eight.simultaneous[0], of_eight.family, of_eight.verdict) == (True, 8, OPEN)
    noisy = planted(gains | {"b": [10.0 * gain for gain in gains["b"]]})
    assert psnr_row(noisy, "a").interval == pytest.approx(alone.interval), "a pooled variance once changed it"


def test_a_robust_mean_stands_next_to_each_and_a_bad_cell_is_named() -> None:
    generator = np.random.default_rng(0)
    gains = {scene: list(0.3 + generator.normal(0, 0.05, 3)) for scene in "abcdefgh"}
    good, bad = psnr_row(planted(gains), "all"), psnr_row(planted(gains | {"c": [*gains["c"][:2], -2.7]}), "all")
    assert (good.flagged, [(cell.scene, cell.seed) for cell in bad.flagged]) == ([], [("c", 2)])
    assert bad.flagged[0].difference == pytest.approx(-2.7)
    assert bad.flagged[0].usual == pytest.approx(0.3, abs=0.05)
    assert good.verdict.sign == "above 0"
    assert bad.verdict == OPEN, "one cell hides it from the mean"
    for row in (good, bad):
        assert row.robust.interval[0] > 0.2
    single = psnr_row(planted(gains), "c")
    assert (single.robust.interval, single.flagged) == (None, []), "three seeds"


def test_families_are_the_declared_ones() -> None:
    rows = compare(planted({scene: [1.0, 2.0] for scene in "abc"}), DUEL)
    families = {(row.metric, row.scene): row.family for row in rows}
    others = len(METRICS) - 1 - len(comparisons.OPTIONAL)
    assert (families["psnr", "all"], families["psnr", "b"]) == (2, 3), "of the headline: at equal steps and time"
    assert (families["ssim", "all"], families["ssim", "b"]) == (others, 3 * others)
    assert comparisons.family_of("psnr", "all", 8, 1) == comparisons.family_of("ssim", "all", 8, 2) == 1


def test_metrics_of_bright_scenes_are_compared_on_those_alone() -> None:
    def bright(cell: CellRecord) -> CellRecord:
        return replace(cell, scores={**cell.scores, "smape": 0.2 + 0.01 * cell.seed}) if cell.scene == "b" else cell

    cells = [bright(quick(method, seed, 20.0, scene)) for method in DUEL for scene in "abc" for seed in range(3)]
    rows = [row for row in compare(cells, DUEL) if row.metric == "smape"]
    assert [(row.scene, row.budget) for row in rows] == [("all", "steps"), ("b", "steps")]
    assert all((row.pairs, row.unpaired) == (3, 0) for row in rows)
    assert rows[1].family == len(METRICS) - 1


def test_pairs_of_the_same_seed_stand_in_the_same_column() -> None:
    """Missing cells do not shift the columns of a table."""
    cells = [quick("nerf", seed, 20.0, scene) for scene in "ab" for seed in range(3)]
    cells += [quick("qnerf", seed, 21.0 + seed, "a") for seed in (0, 2)] + [quick("qnerf", 2, 25.0, "b")]
    table = differences(*keyed(cells), "qnerf", "nerf", "psnr", "steps")
    np.testing.assert_array_equal(table["a"], [1.0, math.nan, 3.0])
    np.testing.assert_array_equal(table["b"], [math.nan, math.nan, 5.0])
    judgement = comparisons.judged(table, "psnr", 1)
    assert (judgement.difference, judgement.pairs, judgement.unpaired) == (3.5, 3, 3)


def test_every_metric_is_compared_at_equal_steps_and_those_of_the_curve_at_equal_time() -> None:
    cells = [quick("nerf", 0, 20.0), quick("qnerf", 0, 21.0)]
    rows = compare(cells, DUEL)
    assert {row.metric for row in rows if row.budget == "steps"} == set(METRICS) - set(comparisons.OPTIONAL)
    assert {row.metric for row in rows if row.budget == "seconds"} == {"psnr"}, "all that an older record has there"
    assert {row.scene for row in rows} == {"lego", "all"}
    by_all = [replace(one, curve=[replace(point, delta_e=2.0) for point in one.curve]) for one in cells]
    found = {row.metric for row in compare(by_all, DUEL) if row.budget == "seconds"}
    assert found == {"psnr", "delta_e"}


def test_over_all_scenes_both_senses_stand_side_by_side() -> None:
    row = psnr_row(planted({"a": [1.0, 2.0, 3.0], "b": [4.0, 4.0, 4.0]}), "all")
    assert (row.difference, row.pairs) == (3.0, 6)
    here, elsewhere = row.on_these_scenes, row.scenes_like_these
    # scenes 2 and 4: standard error 1 with one degree of freedom
    assert elsewhere.interval == pytest.approx((3 - 12.7062, 3 + 12.7062), abs=1e-4)
    # seeds: (1 / 3 + 0 / 3) / 4, of which all is one scene's, with two degrees of freedom
    assert here.interval == pytest.approx((3 - 4.3027 / 12**0.5, 3 + 4.3027 / 12**0.5), abs=1e-3)
    assert (here.verdict.sign, elsewhere.verdict) == ("above 0", OPEN)
    assert (row.interval, row.verdict, row.family) == (elsewhere.interval, OPEN, 2)
    assert here.effect == pytest.approx(3 / 0.5**0.5)
    assert elsewhere.effect == pytest.approx(3 / 2**0.5)


def test_a_single_scene_says_nothing_of_others() -> None:
    cells = planted({"a": [1.0, 1.0, 1.1, 1.2, 1.2]})
    row = psnr_row(cells, "all")
    assert row.scenes_like_these is None
    single = psnr_row(cells, "a")
    assert (row.difference, row.interval, row.robust) == (single.difference, single.interval, single.robust)
    assert [each and each.verdict.sign for each in (row, row.on_these_scenes)] == ["above 0"] * 2


@pytest.mark.parametrize("seeds", [1, 2, 4])
def test_fewer_than_five_seeds_give_no_verdict_on_a_single_scene(seeds: int) -> None:
    cells = planted({scene: [5.0, 5.01, 5.02, 5.01][:seeds] for scene in "abcd"})
    row = psnr_row(cells, "a")
    assert (row.verdict, row.p, row.interval is None) == (OPEN, None, seeds == 1)
    assert psnr_row(cells, "all").verdict.sign == "above 0"


@pytest.mark.parametrize("broken", ["diverged", "collapsed", "missing", "error"])
@pytest.mark.parametrize("budget", ["steps", "seconds"])
def test_a_run_without_a_score_is_counted_and_the_others_are_judged(broken: str, budget: str) -> None:
    cells = planted({scene: [3.0, 2.99, 2.98, 2.97, 2.98, 2.99] for scene in "ab"})
    lost = cells.pop()
    if broken == "collapsed":
        cells.append(replace(lost, warnings=["empty collapse: mean test opacity 0.001"]))
    elif broken != "missing":
        cells.append(replace(diverged("b", "qnerf", 5), status=broken))  # type: ignore[arg-type]
    for scene, pairs in (("b", 5), ("all", 11)):
        row = psnr_row(cells, scene, budget)
        assert (row.pairs, row.unpaired, row.verdict.sign) == (pairs, 1, "above 0")
    assert row.difference == pytest.approx((2.985 + 2.984) / 2)
    if broken == "diverged":  # of the reference alike
        row = psnr_row([*cells[1:], diverged("a", "nerf", 0)], "a")
        assert (row.pairs, row.unpaired, row.difference) == (5, 1, pytest.approx(2.982))


def test_a_method_of_one_scene_is_compared_there_and_not_over_all() -> None:
    cells = planted({"a": [1.0, 1.5, 2.0], "b": [1.0, 1.5, 2.0]})
    cells += [quick("extra", seed, 22.0, "a") for seed in range(3)]
    rows = compare(cells, ["nerf", "qnerf", "extra"])
    assert {row.scene for row in rows if row.method == "extra"} == {"a"}
    assert {row.scene for row in rows if row.method == "qnerf"} == {"a", "b", "all"}
    assert of(rows, method="extra", metric="psnr", budget="steps").family == 1
    # one that failed everywhere on a scene was planned there
    rows = compare([*cells, *(diverged("b", "extra", seed) for seed in range(3))], ["nerf", "qnerf", "extra"])
    assert {row.scene for row in rows if row.method == "extra"} == {"a", "b", "all"}


def test_nothing_left_to_compare_is_a_row_without_a_number() -> None:
    cells = [quick("nerf", seed, 20.0) for seed in range(2)] + [diverged("lego", "qnerf", seed) for seed in range(2)]
    for scene in ("lego", "all"):
        row = psnr_row(cells, scene)
        assert (row.difference, row.interval, row.smallest_detectable) == (None, None, None)
        assert (row.verdict, row.pairs, row.unpaired) == (OPEN, 0, 2)


def test_scores_between_checkpoints_are_linear_in_log_time() -> None:
    curve = [checkpoint(1, 1.0, 10.0), checkpoint(2, 10.0, 20.0), checkpoint(3, 1000.0, 24.0)]
    scored = cell("a", "nerf", 0, curve, scores={"flip": 0.2})
    times = {0.5: None, 1.0: 10.0, math.sqrt(10): 15.0, 100.0: 22.0, 1000.0: 24.0}
    assert {at: comparisons.score_on_curve(scored, "psnr", "seconds", at) for at in times} == pytest.approx(times)
    bridged = replace(scored, curve=[curve[0], checkpoint(2, 10.0, None), checkpoint(3, 100.0, 20.0)])
    assert comparisons.score_on_curve(bridged, "psnr", "seconds", 10.0) == pytest.approx(15.0)
    assert comparisons.score_on_curve(bridged, "ssim", "seconds", 10.0) is None
    assert comparisons.score_on_curve(scored, "flip", "steps", 1.0) is None, "a metric of the end alone is on no curve"


def test_a_method_that_ended_before_the_other_was_first_scored_cannot_be_compared_at_equal_time() -> None:
    cells = [cell("a", "nerf", 0, [checkpoint(100, 5.0, 20.0)]), slow("qnerf", 0, 25.0, "a")]
    late = psnr_row(cells, "a", "seconds")
    assert (late.difference, late.pairs, late.unpaired) == (None, 0, 1)
    assert psnr_row(cells, "a").difference == 5.0


def test_after_a_budget_of_seconds_equal_steps_are_those_that_both_have_done() -> None:
    short = cell("a", "qnerf", 0, [checkpoint(10, 10.0, 20.0), checkpoint(50, 60.0, 26.0)])
    long = cell("a", "nerf", 0, [checkpoint(10, 6.0, 20.0), checkpoint(100, 60.0, 30.0)])
    rows = compare([short, long], DUEL)
    at_50 = 20 + 10 * math.log(5) / math.log(10)
    assert of(rows, scene="a", metric="psnr", budget="steps").difference == pytest.approx(26 - at_50)
    assert of(rows, scene="a", metric="psnr", budget="seconds").difference == -4.0
    # a metric that is scored at the end alone has no value at equal steps
    assert of(rows, scene="a", metric="flip", budget="steps").difference is None


# the family of the headline: sign and interval never contradict each other

METHODS = ["nerf", "nerf_matched", "qnerf"]


def run(scores: np.ndarray, cores: bool = True) -> list[CellRecord]:
    """Return cells with scores [methods, scenes, seeds], which train equally fast."""
    cells = [
        cell(str(scene), method, seed, [checkpoint(10, 5.0, 18.0), checkpoint(100, 10.0, float(value))])
        for method, table in zip(METHODS, scores, strict=True)
        for scene, row in enumerate(table)
        for seed, value in enumerate(row)
    ]
    return [with_core_seconds(one, 1.0) for one in cells] if cores else cells


def drawn(shift: float, scale: float = 0.1, seed: int = 0) -> np.ndarray:
    scores = 25 + np.random.default_rng(seed).normal(0, scale, (3, 8, 3))
    scores[2] += shift
    return scores


def headline(cells: list[CellRecord]) -> list[Comparison]:
    return [row for row in compare(cells, METHODS) if (row.scene, row.metric) == ("all", "psnr")]


def test_the_family_is_every_pair_at_equal_steps_and_equal_core_seconds() -> None:
    families = {(row.budget, row.family) for row in headline(run(drawn(0.1)))}
    assert families == {("steps", 6), ("core_seconds", 6)}
    assert {row.family for row in headline(run(drawn(0.1), cores=False))} == {6}, "seconds, where no others are counted"


def test_signs_are_holms_and_sizes_bonferronis() -> None:
    """Four of six members are almost certain; Holm tests the other two at 2.5 % each, Bonferroni at 0.8 %."""
    scores = drawn(2.0)
    difference = np.random.default_rng(1).normal(0.0, 0.1, 8)
    difference = (difference - difference.mean()) / difference.std(ddof=1)
    error = 1 / 8**0.5
    wanted = (critical(7.0, 2) + critical(7.0, 6)) / 2 * error
    scores[1] = scores[0] + (difference + wanted)[:, None] * 0.1
    rows = {(row.method, row.against, row.budget): row for row in headline(run(scores))}
    row = rows["nerf_matched", "nerf", "steps"]
    like = row.scenes_like_these
    table = {str(scene): scores[1, scene] - scores[0, scene] for scene in range(8)}
    alone = scenes_like_these(table, 6)
    assert alone.simultaneous[0] < 0, "Bonferroni leaves the sign open"
    assert like.p_adjusted == pytest.approx(2 * like.p)
    assert (like.verdict.sign, like.simultaneous) == ("above 0", (0.0, pytest.approx(alone.simultaneous[1])))
    assert (row.verdict, row.simultaneous) == (like.verdict, like.simultaneous), "the row repeats it"


@pytest.mark.parametrize("seed", range(20))
def test_sign_and_interval_never_contradict_each_other(seed: int) -> None:
    shift, scale = np.random.default_rng(seed).uniform((0.0, 0.02), (0.4, 0.4))
    for row in headline(run(drawn(shift, scale, seed))):
        for known in (row.on_these_scenes, row.scenes_like_these):
            low, high = known.simultaneous
            sign = {"above 0": low >= 0, "below 0": high <= 0, "open": low <= 0 <= high}
            assert sign[known.verdict.sign]
            assert (known.verdict.sign == "open") == (known.p_adjusted > LEVEL)
            if known.verdict.size == "matters":
                assert known.verdict.sign != "open"


def test_two_seeds_of_the_only_scene_with_a_pair_settle_nothing() -> None:
    lost = np.full(2, np.nan)
    alone = judged({"lego": np.array([0.30, 0.34])}, "psnr", 1)
    assert judged({"lego": np.array([0.30, 0.34]), "ship": lost}, "psnr", 1).chosen == alone.chosen
    assert alone.chosen.verdict == OPEN
