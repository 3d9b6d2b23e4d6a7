"""Speed gates: ratios from a clock that the test controls."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from harness.gate import gate_speed
from harness.gate.gate_context import GateContext
from harness.gate.gates import SLOWER_FOUND, SPEED_REPEATS, gates
from harness.gate.limits import KindFacts, judge, read_stored
from harness.gate.references import REFERENCES_FILE, References
from harness.machine.processor_class import class_here
from harness.records.study import Check
from scenes.view_sets.view_set import ViewSet
from tests.harness.gate.gate_runs import context_of

GATES = {gate.name: gate for gate in gates() if gate.kind == "speed"}
STORED = read_stored(Path(__file__).parents[3] / "gates" / REFERENCES_FILE, References).speed


class Machine:
    """A clock that advances with the work, not with time."""

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


@pytest.mark.parametrize(
    ("of_class", "name"), [(kind, name) for kind, stored in STORED.items() for name in stored.gates]
)
def test_one_and_a_half_times_as_long_fails_by_the_stored_spread(of_class: str, name: str) -> None:
    """At least nine of ten slower runs fail, and at least nine of ten unchanged runs pass."""
    gate, ratios = GATES[name], STORED[of_class].gates[name]
    limit = gate_speed.limit_of(ratios)
    assert limit.detects <= SLOWER_FOUND
    generator = np.random.default_rng(0)
    failed = {factor: 0 for factor in (1.0, SLOWER_FOUND)}
    for factor in failed:
        for noise in limit.spread * generator.standard_normal(500):  # type: ignore[operator]
            failed[factor] += judge(gate, [factor * math.exp(noise)], limit).is_broken
    assert failed[1.0] < 50
    assert failed[SLOWER_FOUND] > 450


def test_faster_is_welcome() -> None:
    assert gate_speed.limit_of([2.4, 2.5, 2.6]).low is None


def test_a_class_without_a_quotient_is_not_available_and_says_how_to_make_one(
    limits: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gate_speed, "in_child", lambda function, names: dict.fromkeys(names, 2.1))
    context = context_of(tuple(GATES.values()), limits)

    def statuses(context: GateContext) -> dict[str, str]:
        return {check.id: check.status for check in gate_speed.measure(context) if isinstance(check, Check)}

    assert statuses(context) == dict.fromkeys(GATES, "not_available") | {"speed.score": "pass"}
    elsewhere = replace(context, references=structs.replace(context.references, speed={}))
    assert statuses(elsewhere) == dict.fromkeys(GATES, "not_available")
    (check,) = gate_speed.measure(replace(elsewhere, gates=(GATES["speed.score"],)))
    assert isinstance(check, Check)
    assert f"no reference of processors of class {class_here()}" in check.why
    assert not check.is_broken
    other_settings = KindFacts({"repeats": 3}, {}, 1.0)
    speed = {name: structs.replace(stored, facts=other_settings) for name, stored in context.references.speed.items()}
    renewed = replace(context, references=structs.replace(context.references, speed=speed))
    assert statuses(renewed) == dict.fromkeys(GATES, "fail")


def test_each_gate_has_something_to_measure(ball: ViewSet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate_speed, "STEPS_BEFORE", 2)
    for name in ("speed.train.qnerf", "speed.render.nerf", "speed.score"):
        for side in gate_speed.sides_of(name, ball):
            side()
            side()
