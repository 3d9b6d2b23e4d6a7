"""Fairness gates: null where nothing is unfair, and broken on purpose."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baselines.catalog import CATALOG
from harness import comparisons
from harness.batches import Batches
from harness.gate import fairness
from harness.gate.catalog import TRAINED_METHODS, gates
from harness.gate.fairness import (
    copied,
    copy_of,
    drawn,
    effect_found,
    first_weights,
    other_batches,
    seen_differences,
    share_called,
)
from harness.gate.limits import exact_limit, excess_of
from harness.statistics import PairedDifference
from scenes.view_set import ViewSet

METHODS = ("nerf", "qnerf")
SPREADS = {"lego": 0.25, "drums": 0.13}
LEVEL = 0.01 / len(gates())
LIMITS = {gate.rule: exact_limit(gate, LEVEL) for gate in gates() if gate.kind == "fairness" and gate.rule != "null"}


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> ViewSet:
    return drawn(tmp_path_factory.mktemp("drawn"))


@pytest.fixture(autouse=True)
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fairness, "COPY_STEPS", 6)


def seeded_by_method(monkeypatch: pytest.MonkeyPatch) -> None:
    """First weights, jitter and grid then depend on the method's name."""
    usual = fairness.learner_for

    def unfair(method: str, box: Any, settings: Any, budget: Any, seed: Any, *others: Any) -> Any:
        return usual(method, box, settings, budget, f"{seed}/{method}", *others)

    monkeypatch.setattr(fairness, "learner_for", unfair)


def test_first_weights_are_equal_where_methods_share_them(views: ViewSet, monkeypatch: pytest.MonkeyPatch) -> None:
    assert first_weights(TRAINED_METHODS, views) == 0
    seeded_by_method(monkeypatch)
    differing = first_weights(METHODS, views)
    assert differing is not None
    assert differing > 1000
    assert excess_of(differing, LIMITS["none_differs"]) > 0


def test_nothing_in_common_is_no_proof(views: ViewSet) -> None:
    assert first_weights(("nerf",), views) is None


def test_batches_are_equal(views: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert other_batches(METHODS, views, tmp_path) == 0
    assert other_batches(METHODS[:1], views, tmp_path) is None
    calls = 0

    def one_after_another(self: Batches, seed: int | str, step: int, count: int) -> Any:
        nonlocal calls
        calls += 1
        return self._drawn(seed, calls, count)

    # a stream that goes on with every call, as a hidden global generator does
    monkeypatch.setattr(Batches, "batch", one_after_another)
    assert other_batches(METHODS, views, tmp_path) == 6


@pytest.mark.parametrize("method", METHODS)
def test_copies_end_bit_for_bit_alike(
    method: str, views: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = set(CATALOG)
    differing, cells = copied(method, views, tmp_path)
    assert differing == 0
    assert {(cell.method, cell.seed) for cell in cells} == {
        (name, seed) for name in (method, copy_of(method)) for seed in (0, 1)
    }
    assert seen_differences(cells, method, copy_of(method)) == 0
    seeded_by_method(monkeypatch)
    differing, cells = copied(method, views, tmp_path)
    assert differing is not None
    assert excess_of(differing, LIMITS["none_differs"]) > 0
    seen = seen_differences(cells, method, copy_of(method))
    assert seen is not None
    assert seen > 0
    assert set(CATALOG) == before, "the copy's name is gone"


def test_a_copy_that_does_not_end_is_nothing_to_compare(
    views: ViewSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = fairness.learner_for

    def failing(method: str, *others: Any) -> Any:
        if method.startswith("another"):
            raise RuntimeError("broken")
        return usual(method, *others)

    monkeypatch.setattr(fairness, "learner_for", failing)
    assert copied("nerf", views, tmp_path)[0] is None


@pytest.mark.slow
def test_a_comparer_that_is_sound_calls_chance_seldom_and_finds_what_is_there() -> None:
    calls, found = share_called(SPREADS, planted=False), share_called(SPREADS, planted=True)
    assert excess_of(calls, LIMITS["false_calls"]) <= 0
    assert excess_of(found, LIMITS["found"]) <= 0
    assert found == pytest.approx(0.8, abs=0.04)


def test_the_planted_effect_by_simulation() -> None:
    generator = np.random.default_rng(0)
    values = effect_found(3) + generator.standard_normal((40_000, 3))
    t = values.mean(axis=1) / (values.std(axis=1, ddof=1) / 3**0.5)
    assert np.mean(t > 4.302653) == pytest.approx(0.8, abs=0.008)


def narrow(result: PairedDifference) -> PairedDifference:
    """Intervals of a third of their width, as if pixels were the units."""
    assert result.simultaneous is not None
    low, high = (result.mean + (limit - result.mean) / 3 for limit in result.simultaneous)
    return replace(result, interval=(low, high), simultaneous=(low, high))


def blind(result: PairedDifference) -> PairedDifference:
    return replace(result, interval=(-1e9, 1e9), simultaneous=(-1e9, 1e9))


def test_a_comparer_that_is_too_sure_or_blind_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    usual = comparisons.on_one_scene
    monkeypatch.setattr(comparisons, "on_one_scene", lambda *given: narrow(usual(*given)))
    assert excess_of(share_called(SPREADS, planted=False, repeats=200), LIMITS["false_calls"]) > 0
    monkeypatch.setattr(comparisons, "on_one_scene", lambda *given: blind(usual(*given)))
    assert excess_of(share_called(SPREADS, planted=True, repeats=200), LIMITS["found"]) > 0
