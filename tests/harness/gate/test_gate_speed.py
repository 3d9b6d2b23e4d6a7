"""Speed gates: ratios from figures of a clock that the test holds."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.gate import gate_speed
from harness.gate.gates import SLOWER_FOUND, SPEED_REPEATS, gates
from harness.gate.limits import judge
from harness.gate.references import read_references
from scenes.view_sets.view_set import ViewSet

GATES = [gate for gate in gates() if gate.kind == "speed"]
CLASSES = Path(__file__).parents[3] / "gates" / "classes"


class Machine:
    """A clock that goes on by what is done, not by time."""

    def __init__(self) -> None:
        self.now = 0.0
        self.load = 1.0

    def clock(self) -> float:
        return self.now

    def work(self, seconds: float) -> Callable[[], object]:
        def call() -> None:
            self.now += seconds * self.load

        return call


@pytest.fixture
def machine() -> Machine:
    return Machine()


def test_a_ratio_is_of_the_plain_code_whatever_the_machine_does(machine: Machine) -> None:
    assert gate_speed.ratio(machine.work(0.025), machine.work(0.010), machine.clock) == pytest.approx(2.5)
    machine.load = 7.0
    assert gate_speed.ratio(machine.work(0.025), machine.work(0.010), machine.clock) == pytest.approx(2.5)


def test_a_few_disturbed_repetitions_do_not_count(machine: Machine) -> None:
    calls = 0

    def side() -> None:
        nonlocal calls
        calls += 1
        machine.now += 0.5 if calls % 4 == 0 else 0.025

    assert gate_speed.ratio(side, machine.work(0.010), machine.clock) == pytest.approx(2.5)
    assert calls > SPEED_REPEATS


@pytest.mark.parametrize("gate", GATES, ids=lambda gate: gate.name)
@pytest.mark.parametrize("name", ["avx2", "avx512"])
def test_one_and_a_half_times_as_long_fails_by_the_stored_spread(name: str, gate: Any) -> None:
    """In nine of ten runs at least, and what did not change passes in as many."""
    ratios = read_references(CLASSES, name).speed[gate.name]
    limit = gate_speed.limit_of(ratios)
    assert limit.detects is not None
    assert limit.detects <= SLOWER_FOUND
    generator = np.random.default_rng(0)
    failed = {factor: 0 for factor in (1.0, SLOWER_FOUND)}
    for factor in failed:
        for noise in limit.spread * generator.standard_normal(500):  # type: ignore[operator]
            failed[factor] += judge(gate, [factor * math.exp(noise)], limit).is_broken
    assert failed[1.0] < 50
    assert failed[SLOWER_FOUND] > 450


def test_faster_is_welcome_and_a_foreign_class_has_more_room() -> None:
    ratios = [2.4, 2.5, 2.6]
    assert gate_speed.limit_of(ratios).low is None
    assert gate_speed.limit_of(ratios, 1.5).high == pytest.approx(1.5 * 1.5**0.5)


def test_each_gate_has_something_to_measure(ball: ViewSet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate_speed, "STEPS_BEFORE", 2)
    for name in ("speed.train.qnerf", "speed.render.nerf", "speed.score"):
        for side in gate_speed.sides_of(name, ball):
            side()
            side()
