"""Fairness gates count nothing in a fair comparison; the gates of families are judged by the spread of seeds."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from baselines.catalog import CATALOG
from harness.gate import fairness, gate_families
from harness.gate.fairness import copied, copy_of, drawn, first_weights, other_batches, seen_differences
from harness.gate.gates import FAMILIES, FAMILY_RENEWAL, FAMILY_SEEDS, TRAINED_METHODS, gates
from harness.records.cells import CellRecord
from harness.records.study import Check
from harness.training.batches import Batches
from harness.training.learner import Job
from scenes.files.errors import InputError
from scenes.view_sets.view_set import ViewSet
from tests.harness.cells import cell, checkpoint
from tests.harness.gate.gate_runs import CENTRE, context_of
from tests.harness.patching import preceded

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


@pytest.mark.slow
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


@pytest.mark.slow
def test_copies_end_bit_for_bit_alike(views: ViewSet, tmp_path: Path, monkeypatch: Patch) -> None:
    method, before = "qnerf", set(CATALOG)
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
    def failing(job: Job) -> None:
        if job.method.startswith("another"):
            raise RuntimeError("broken")

    preceded(monkeypatch, fairness, "learner_for", failing)
    assert copied("nerf", views, tmp_path)[0] is None


# families


def cells(seeds: tuple[int, ...], psnr: float = CENTRE, **others: object) -> list[CellRecord]:
    made = [cell("lego", name, seed, [checkpoint(150, 1.0, psnr)]) for name in FAMILIES for seed in seeds]
    return [structs.replace(one, scores={"psnr": psnr}, **others) for one in made]


@pytest.mark.parametrize(
    ("psnr", "others", "status", "why"),
    [
        (CENTRE, {}, "pass", "detects"),
        (CENTRE - 1.0, {}, "fail", "detects"),
        (CENTRE, {"status": "diverged", "reason": "step 3: loss"}, "fail", "step 3: loss"),
        (CENTRE, {"status": "not_available", "reason": "needs LLVM"}, "not_available", "needs LLVM"),
    ],
)
def test_a_family_is_held_to_the_spread_of_seeds_and_fails_with_its_reason_unless_it_cannot_run_here(
    psnr: float, others: dict[str, str], status: str, why: str, limits: Path, monkeypatch: Patch
) -> None:
    monkeypatch.setattr(gate_families, "trained", lambda *given, **named: cells(FAMILY_SEEDS, psnr, **others))
    chosen = tuple(gate for gate in gates() if gate.kind == "families")
    checks = [check for check in gate_families.measure(context_of(chosen, limits)) if isinstance(check, Check)]
    assert [check.id for check in checks] == [f"families.{name}" for name in FAMILIES]
    for check in checks:
        assert (check.status, check.is_broken) == (status, status == "fail")
        assert check.why.startswith(why)


def test_limits_are_made_of_trainings_that_ended(limits: Path, monkeypatch: Patch) -> None:
    context = context_of((), limits)
    monkeypatch.setattr(gate_families, "trained", lambda *given, **named: cells(FAMILY_RENEWAL))
    assert gate_families.renew(context) == {f"families.{name}": [CENTRE] * len(FAMILY_RENEWAL) for name in FAMILIES}
    monkeypatch.setattr(gate_families, "trained", lambda *given, **named: cells(FAMILY_RENEWAL, status="diverged"))
    with pytest.raises(InputError, match="trainings that did not end"):
        gate_families.renew(context)
    assert not set(FAMILY_SEEDS) & set(FAMILY_RENEWAL), "no seed of a gate is one of its limits"
