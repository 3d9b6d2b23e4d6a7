"""Groups, intervals and suspect results agree with slow references, invariants and simulations."""

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest
from scipy.stats import ttest_1samp, ttest_rel

from harness.records.judgements import JudgementRecord, Ranking, changed_pairs
from harness.records.verdict import OPEN, Verdict
from harness.verdicts.estimates.max_t import step_down_max_t
from harness.verdicts.estimates.multiplicity import holm
from harness.verdicts.judging.judgement import adjusted_means, judge, letters_line, ranking, suspects, without
from harness.verdicts.tables.result_table import ResultTable, read_table
from tests.harness.shell import ROOT


def table_of(values: np.ndarray, **more: object) -> ResultTable:
    """Return the table of values [methods, scenes] or [methods, scenes, seeds]."""
    values = values[..., None] if values.ndim == 2 else values
    methods, scenes, seeds = values.shape
    names = [[f"{kind}{place}" for place in range(many)] for kind, many in (("m", methods), ("s", scenes))]
    of_seeds = [str(seed) for seed in range(seeds)] if seeds > 1 else [""]
    none: list[float | None] = [None] * methods
    made = ResultTable("t.csv", "psnr", True, *names, of_seeds, values, none, none, none, [])
    return replace(made, **more)  # type: ignore[arg-type]


def drawn(seed: int, methods: int = 6, scenes: int = 8, effect: float = 0.0) -> np.ndarray:
    random = np.random.default_rng(seed)
    steps = effect * np.arange(methods)[:, None]
    return 30 + steps + random.normal(0, 3, scenes) + random.normal(0, 0.5, (methods, scenes))


def collapsed() -> np.ndarray:
    values = drawn(0, methods=5, effect=1.0)
    values[2, 6] -= 20
    return values


def distinguished(result: Ranking) -> set[frozenset[str]]:
    return {frozenset((pair.method, pair.against)) for pair in result.pairs if pair.distinguished}


@pytest.mark.parametrize("scenes", [5, 8])
@pytest.mark.parametrize("seed", range(3))
def test_signs_are_those_of_the_procedure_for_all_pairs(seed: int, scenes: int) -> None:
    """By sign flips of the scenes, or with fewer than six of them by Holm's procedure on paired t-tests."""
    values = drawn(seed, scenes=scenes, effect=0.5)
    result = ranking(table_of(values), margin=0.0)
    assert len(result.pairs) == result.family == 15
    both = [[values[int(name[1:])] for name in (pair.method, pair.against)] for pair in result.pairs]
    if scenes == 5:
        p = holm([float(ttest_rel(a, b).pvalue) for a, b in both])
    else:
        p = step_down_max_t(np.array([a - b for a, b in both])).tolist()
    for pair, adjusted, (a, b) in zip(result.pairs, p, both, strict=True):
        assert pair.difference == pytest.approx(a.mean() - b.mean())
        assert pair.distinguished == (adjusted <= 0.05)
        assert pair.scenes_like_these is not None
        assert pair.scenes_like_these.p_adjusted == pytest.approx(adjusted)
        assert pair.scenes_like_these.simultaneous is not None
        low, high = pair.scenes_like_these.simultaneous
        assert low <= 0.0 <= high if not pair.distinguished else low >= 0.0 or high <= 0.0
    assert {pair.distinguished for pair in result.pairs} == {True, False}


def test_letters_ranks_and_the_probability_of_being_best() -> None:
    result = ranking(table_of(drawn(1, methods=9, effect=0.3)), margin=0.0)
    apart, places = distinguished(result), result.places
    for one, other in combinations(places, 2):
        assert bool({*one.groups} & {*other.groups}) == (frozenset((one.method, other.method)) not in apart)
    for at, place in enumerate(places, 1):
        known = [other for other in places if frozenset((place.method, other.method)) in apart]
        above = sum(other.mean > place.mean for other in known)
        assert place.rank == (1 + above, len(places) - (len(known) - above))
        assert place.rank[0] <= at <= place.rank[1]
    assert sum(place.best or 0.0 for place in places) == pytest.approx(1.0)
    # ahead on six of eight scenes by as much as it is behind on two: P(Beta(6, 2) > 1/2)
    values = np.array([[31.0] * 6 + [29.0] * 2, [30.0] * 8])
    (best, _) = ranking(table_of(values), 0.0).places
    assert best.best == pytest.approx(1 - 8 / 2**7, abs=0.02)
    few = ranking(table_of(values[:, :5]), 0.0).places
    assert [place.best for place in few] == [None, None], "too few scenes"
    values[1, 0] = np.nan
    assert [place.best for place in ranking(table_of(values), 0.0).places] == [None, None], "scenes are missing"


def test_the_scenes_that_would_settle_a_sign_find_it_in_80_of_100_tables() -> None:
    values = np.zeros((2, 8))
    values[0] = 0.2 + np.array([1.0, -1.0] * 4) * 0.5
    (pair,) = ranking(table_of(values), 0.0).pairs
    count = pair.scenes_to_settle
    assert count is not None
    spread = values[0].std(ddof=1)
    random = np.random.default_rng(0)
    found = sum(ttest_1samp(random.normal(0.2, spread, count), 0.0).pvalue < 0.05 for _ in range(2000))
    assert 0.77 < found / 2000 < 0.83
    (known,) = ranking(table_of(values + np.array([[9.0], [0.0]])), 0.0).pairs
    assert known.scenes_to_settle is None


def test_without_letters_no_line_speaks_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    result = ranking(table_of(drawn(1)), margin=0.0)
    assert letters_line(result) == "Two methods are distinguished unless they share a letter."
    monkeypatch.setattr("harness.verdicts.estimates.max_t.MOST_LETTERS", 0)
    without_letters = ranking(table_of(drawn(1, effect=0.5)), margin=0.0)
    assert any(pair.distinguished for pair in without_letters.pairs)
    assert letters_line(without_letters).startswith("No letters are given")


@pytest.mark.parametrize("change", [-10.0, 10.0])
def test_a_cell_ten_db_off_its_pattern_is_suspect_in_nine_of_ten_places(change: float) -> None:
    """Planted in a public leaderboard in turn, whose methods and scenes have very different spreads."""
    table = read_table([ROOT / "docs" / "examples" / "nerfbaselines-blender.csv"])
    missed = 0
    for place in np.ndindex(*table.values.shape):
        values = table.values.copy()
        values[place] += change
        named = table.methods[place[0]], table.scenes[place[1]]
        missed += named not in {(each.method, each.scene) for each in suspects(replace(table, values=values), 0.2)}
    assert missed <= 0.1 * table.values.size


def test_lower_is_better_mirrors_every_verdict() -> None:
    values = drawn(3, effect=0.4)
    up = ranking(table_of(values), 0.2)
    down = ranking(table_of(-values, higher_is_better=False), 0.2)
    assert [each.method for each in up.places] == [each.method for each in down.places]
    assert [each.groups for each in up.places] == [each.groups for each in down.places]
    turned = [(pair.method, pair.against, pair.verdict.turned) for pair in down.pairs]
    assert turned == [(pair.method, pair.against, pair.verdict) for pair in up.pairs]


def test_the_order_of_methods_scenes_and_seeds_changes_nothing() -> None:
    values = np.random.default_rng(1).normal(30, 1, (4, 6, 3)) + np.arange(4)[:, None, None]
    plain, turned = table_of(values), table_of(values[::-1, ::-1, ::-1])
    turned = replace(turned, methods=plain.methods[::-1], scenes=plain.scenes[::-1], seeds=plain.seeds[::-1])
    for each, other in zip(ranking(plain, 0.2).pairs, ranking(turned, 0.2).pairs, strict=True):
        assert (each.method, each.against, each.verdict) == (other.method, other.against, other.verdict)
        assert each.on_these_scenes
        assert other.on_these_scenes
        assert each.on_these_scenes.interval == pytest.approx(other.on_these_scenes.interval)


def test_pairs_are_compared_on_the_scenes_that_both_have() -> None:
    values = drawn(2, methods=3)
    values[0, 0] = values[1, 1] = np.nan
    values[2, 2:] = np.nan
    result = judge(table_of(values), None, None)
    pairs = {frozenset((pair.method, pair.against)): pair for pair in result.given.pairs}
    first = pairs[frozenset(("m0", "m1"))]
    sign = 1 if first.method == "m0" else -1
    assert first.scenes == 6
    assert first.difference == pytest.approx(sign * (values[0, 2:] - values[1, 2:]).mean())
    lonely = pairs[frozenset(("m0", "m2"))]
    assert (lonely.scenes, lonely.scenes_like_these, lonely.verdict) == (1, None, OPEN)
    assert result.missing == ["m0, s0", "m1, s1", *(f"m2, s{scene}" for scene in range(2, 8))]
    values[2] = np.nan
    values[2, 0] = 30.0
    pairs = {frozenset((pair.method, pair.against)): pair for pair in ranking(table_of(values), 0.2).pairs}
    assert pairs[frozenset(("m0", "m2"))].difference is None


def test_a_mean_is_adjusted_for_missing_scenes_by_least_squares() -> None:
    values = drawn(4, methods=5)
    assert adjusted_means(values) == pytest.approx(values.mean(axis=1))
    values[np.random.default_rng(0).random(values.shape) < 0.3] = np.nan
    at = np.argwhere(np.isfinite(values))
    design = np.hstack([np.eye(5)[at[:, 0]], np.eye(8)[at[:, 1]]])
    solved = np.linalg.lstsq(design, values[tuple(at.T)], rcond=None)[0]
    assert adjusted_means(values) == pytest.approx(solved[:5] + solved[5:].mean(), abs=1e-6)


def test_a_collapsed_cell_is_found_and_judged_with_and_without() -> None:
    values = collapsed()
    result = judge(table_of(values), None, None)
    (each,) = result.suspects
    assert (each.method, each.scene, each.value) == ("m2", "s6", values[2, 6])
    assert each.value - each.expected == pytest.approx(-20, abs=1.5)
    assert result.without_suspects
    assert result.without_suspects.pairs == ranking(table_of(np.where(values == each.value, np.nan, values)), 0.2).pairs
    changes = {frozenset((pair.method, pair.against)): after for pair, after in changed_pairs(result)}
    assert changes[frozenset(("m2", "m0"))].sign != "open"
    assert all("m2" in names for names in changes)


def test_one_collapsed_seed_of_many_is_found() -> None:
    values = 30 + np.random.default_rng(0).normal(0, 0.3, (4, 8, 3))
    values[1, 2, 0] += 9
    assert [(each.method, each.scene, each.seed) for each in suspects(table_of(values), 0.2)] == [("m1", "s2", "0")]


@pytest.mark.parametrize(("methods", "scenes", "freedom", "most"), [(3, 3, 99, 1), (17, 8, 99, 1), (17, 8, 4, 30)])
def test_few_ordinary_tables_have_a_suspect(methods: int, scenes: int, freedom: int, most: int) -> None:
    random = np.random.default_rng(7)
    tables = [30 + random.standard_t(freedom, (methods, scenes)) * 0.3 for _ in range(100)]
    assert sum(bool(suspects(table_of(values), 0.2)) for values in tables) <= most
    spoilt = np.where(tables[0] == tables[0].max(), 0.0, tables[0])
    assert [each.value for each in suspects(table_of(spoilt), 0.2)] == [0.0]


def test_small_tables_and_tables_of_equal_numbers_are_judged() -> None:
    two = table_of(drawn(0, methods=2))
    two.values[0, 0] = 3.0
    assert suspects(two, 0.2) == [], "with two methods it is unknown which is the outlier"
    assert without(two, []) is None
    rounded = ranking(table_of(np.array([[31.1, 33.1], [31.0, 33.0]])), 0.2)
    assert [pair.verdict for pair in rounded.pairs] == [OPEN], "two differences that are printed as equal"
    equal: JudgementRecord = judge(table_of(np.full((3, 6), 30.0)), None, None)
    assert [pair.verdict for pair in equal.given.pairs] == [Verdict("open", "smaller than matters")] * 3
    assert all(pair.on_these_scenes is None and pair.scenes_like_these for pair in equal.given.pairs), "without seeds"
    assert equal.suspects == []
    assert [place.groups for place in equal.given.places] == [[1]] * 3
    assert all(pair.against == after.method for pair, after in pairwise(equal.given.neighbours))
