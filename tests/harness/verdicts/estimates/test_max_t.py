"""Adjusted p-values against definitions and references; letters against the relation they display."""

from itertools import combinations, product

import numpy as np
import pytest
from scipy.stats import false_discovery_control

from harness.verdicts.estimates import max_t
from harness.verdicts.estimates.max_t import letters, step_down_max_t, written
from harness.verdicts.estimates.multiplicity import benjamini_hochberg, holm


def by_definition(differences: np.ndarray) -> list[float]:
    """Return adjusted p-values: of each pair, over all flips, the share in which the largest |t| of it and of all pairs
    with smaller |t| reaches its own; no smaller than that of a pair before it.
    """
    pairs, units = differences.shape

    def score(values: np.ndarray) -> float:
        deviation = values.std(ddof=1)
        return abs(values.mean()) / deviation * units**0.5 if deviation > 0 else np.inf

    observed = [score(row) for row in differences]
    order = sorted(range(pairs), key=lambda pair: -observed[pair])
    flipped = [[score(row * signs) for row in differences] for signs in product((1, -1), repeat=units)]
    adjusted, before = [0.0] * pairs, 0.0
    for place, pair in enumerate(order):
        rest = order[place:]
        reached = np.mean([max(scores[other] for other in rest) >= observed[pair] - 1e-9 for scores in flipped])
        adjusted[pair] = before = max(before, float(reached))
    return adjusted


@pytest.mark.parametrize("seed", range(3))
def test_p_values_are_those_of_the_definition(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(max_t, "CHUNK", 7)
    values = np.random.default_rng(seed).normal(np.arange(4)[:, None] * 0.5, 1.0, (4, 7))
    differences = np.array([values[a] - values[b] for a, b in combinations(range(4), 2)])
    assert step_down_max_t(differences) == pytest.approx(by_definition(differences), abs=1e-12)


def test_signs_scale_and_order_change_nothing() -> None:
    differences = np.random.default_rng(3).normal(0.4, 1.0, (5, 9))
    expected = step_down_max_t(differences)
    assert step_down_max_t(-differences[::-1] * [[1e-6], [1.0], [-3.0], [1e6], [2.0]]) == pytest.approx(expected[::-1])
    assert step_down_max_t(differences[:, ::-1]) == pytest.approx(expected)


def test_missing_equal_and_constant_differences() -> None:
    differences = np.random.default_rng(4).normal(0.0, 1.0, (4, 8))
    differences[0], differences[1], differences[2, 1:] = 0.0, 0.3, np.nan
    p = step_down_max_t(differences)
    assert (p[0], p[2]) == (1.0, 1.0), "no difference, and one scene alone"
    assert p[1] == 1 / 2**7, "the smallest that eight scenes allow"
    more = np.concatenate([differences, np.full((4, 2), np.nan)], axis=1)
    assert step_down_max_t(more) == pytest.approx(p), "scenes without results"


def test_many_scenes_are_sampled_alike_each_time() -> None:
    differences = np.random.default_rng(5).normal(0.5, 1.0, (3, 40))
    assert max_t.MOST_FLIPS < 2**39
    assert (step_down_max_t(differences) == step_down_max_t(differences.copy())).all()


@pytest.mark.parametrize("seed", range(6))
def test_two_share_a_letter_if_and_only_if_they_are_not_distinguished(seed: int) -> None:
    random = np.random.default_rng(seed)
    count = 9
    apart = [pair for pair in combinations(range(count), 2) if random.random() < (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)[seed]]
    given = [set(numbers) for numbers in letters(count, apart)]
    for a, b in combinations(range(count), 2):
        assert bool(given[a] & given[b]) == ((a, b) not in apart)
    members = [{k for k in range(count) if number in given[k]} for number in set().union(*given)]
    assert not any(one < other for one in members for other in members), "no letter says less than another"
    assert min(given[0]) == 1


def test_letters_are_written_as_in_the_alphabet() -> None:
    assert [written(numbers) for numbers in ([1], [1, 3], [26, 27], [53], [])] == ["a", "ac", "z aa", "ba", ""]
    chain = [(k, k + 1) for k in range(0, 24, 2)]
    assert letters(24, chain) == [[]] * 24, "2¹² letters help nobody"


# Holm, and Benjamini and Hochberg


def test_holm_by_hand() -> None:
    assert holm([0.01, 0.04, 0.03, None, 0.005]) == pytest.approx([0.03, 0.06, 0.06, None, 0.02])
    assert holm([0.02, 0.5], family=4) == pytest.approx([0.08, 1.0])
    assert holm([]) == []
    assert holm([None]) == [None]


def test_benjamini_and_hochberg_as_scipy_has_it() -> None:
    p = np.random.default_rng(1).beta(0.3, 1.0, 40)
    found = benjamini_hochberg([None, *p.tolist(), None])
    assert found[0] is found[-1] is None
    assert found[1:-1] == pytest.approx(false_discovery_control(p).tolist())
