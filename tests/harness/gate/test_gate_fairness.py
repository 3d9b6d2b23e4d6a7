"""Fairness gates count nothing in a fair comparison, and find deliberate unfairness."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from baselines.catalog import CATALOG
from harness.gate import fairness
from harness.gate.fairness import copied, copy_of, drawn, first_weights, other_batches, seen_differences
from harness.gate.gates import TRAINED_METHODS
from harness.training.batches import Batches
from harness.training.learner import Job
from scenes.view_sets.view_set import ViewSet

Patch = pytest.MonkeyPatch
METHODS = ("nerf", "qnerf")


@pytest.fixture(scope="module")
def views() -> ViewSet:
    return drawn()


@pytest.fixture(autouse=True)
def few_steps(monkeypatch: Patch) -> None:
    monkeypatch.setattr(fairness, "COPY_STEPS", 6)


def seeded_by_method(monkeypatch: Patch) -> None:
    """Make first weights, jitter and grid depend on the method's name."""
    usual = fairness.learner_for

    def unfair(job: Job) -> Any:
        return usual(replace(job, seed=f"{job.seed}/{job.method}"))

    monkeypatch.setattr(fairness, "learner_for", unfair)


def test_first_weights_are_equal_where_methods_share_them(views: ViewSet, monkeypatch: Patch) -> None:
    assert first_weights(TRAINED_METHODS, views) == 0
    assert first_weights(("nerf",), views) is None, "nothing in common is no proof"
    seeded_by_method(monkeypatch)
    differing = first_weights(METHODS, views)
    assert differing > 1000


def test_batches_are_equal(views: ViewSet, tmp_path: Path, monkeypatch: Patch) -> None:
    assert other_batches(METHODS, views, tmp_path) == 0
    assert other_batches(METHODS[:1], views, tmp_path) is None
    calls = 0

    def one_after_another(self: Batches, seed: int | str, step: int, count: int) -> Any:
        nonlocal calls
        calls += 1
        return self._drawn(seed, calls, count)

    # a stream that advances with every call, as a hidden global generator does
    monkeypatch.setattr(Batches, "batch", one_after_another)
    assert other_batches(METHODS, views, tmp_path) == 6


@pytest.mark.parametrize("method", METHODS)
def test_copies_end_bit_for_bit_alike(method: str, views: ViewSet, tmp_path: Path, monkeypatch: Patch) -> None:
    before = set(CATALOG)
    differing, cells = copied(method, views, tmp_path)
    assert differing == 0
    assert {(cell.method, cell.seed) for cell in cells} == {
        (name, seed) for name in (method, copy_of(method)) for seed in (0, 1)
    }
    assert seen_differences(cells, method) == 0
    seeded_by_method(monkeypatch)
    differing, cells = copied(method, views, tmp_path)
    assert differing > 0
    seen = seen_differences(cells, method)
    assert seen > 0
    assert set(CATALOG) == before, "the copy's name is gone"


def test_a_copy_that_does_not_end_is_nothing_to_compare(views: ViewSet, tmp_path: Path, monkeypatch: Patch) -> None:
    usual = fairness.learner_for

    def failing(job: Job) -> Any:
        if job.method.startswith("another"):
            raise RuntimeError("broken")
        return usual(job)

    monkeypatch.setattr(fairness, "learner_for", failing)
    assert copied("nerf", views, tmp_path)[0] is None
