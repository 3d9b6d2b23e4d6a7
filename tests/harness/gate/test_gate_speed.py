"""Speed gates: a ratio from a clock that the test controls, and limits from the stored quotients."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from harness.gate import gate_speed
from harness.gate.gate_context import GateContext
from harness.gate.gates import SLOWER_FOUND, SPEED_REPEATS, gates
from harness.gate.limits import KindFacts, judge
from harness.gate.references import References
from harness.machine.processor_class import class_here
from harness.records.study import Check
from scenes.view_sets.view_set import ViewSet
from tests.harness.gate.gate_runs import context_of

GATES = {gate.name: gate for gate in gates() if gate.kind == "speed"}


def test_a_ratio_is_of_the_plain_code_and_a_few_disturbed_repetitions_do_not_count() -> None:
    now, calls = 0.0, 0

    def side() -> None:
        nonlocal now, calls
        calls += 1
        now += 0.5 if calls % 4 == 0 else 0.025

    def plain() -> None:
        nonlocal now
        now += 0.010

    assert gate_speed.ratio(side, plain, lambda: now) == pytest.approx(2.5)
    assert calls > SPEED_REPEATS


def test_one_and_a_half_times_as_long_fails_by_the_stored_spread(stored: References) -> None:
    """At least nine of ten slower runs fail, and at least nine of ten unchanged runs pass; faster is welcome."""
    generator = np.random.default_rng(0)
    of_classes = [(name, ratios) for speed in stored.speed.values() for name, ratios in speed.gates.items()]
    assert of_classes
    for name, ratios in of_classes:
        limit = gate_speed.limit_of(ratios)
        assert limit.low is None
        assert limit.detects <= SLOWER_FOUND, name
        noise = np.exp(limit.spread * generator.standard_normal(500))
        for factor, least, most in ((1.0, 0, 49), (SLOWER_FOUND, 451, 500)):
            failed = sum(judge(GATES[name], [factor * float(one)], limit).is_broken for one in noise)
            assert least <= failed <= most, (name, factor)


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


@pytest.mark.slow
def test_each_gate_has_something_to_measure(ball: ViewSet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate_speed, "STEPS_BEFORE", 2)
    for name in ("speed.train.qnerf", "speed.render.nerf", "speed.score"):
        for side in gate_speed.sides_of(name, ball):
            side()
            side()
