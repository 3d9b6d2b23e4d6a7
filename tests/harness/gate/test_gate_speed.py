"""Speed gates: ratios from figures of a clock that the test holds."""

from collections.abc import Callable
from pathlib import Path

import pytest

from harness.gate import speed
from harness.gate.catalog import SPEED_MARGIN, SPEED_REPEATS, Gate, gates
from harness.gate.limits import limit_from
from harness.gate.limits_file import read_limits
from harness.gate.options import LIMITS
from harness.gate.outcome import Sample, judged
from scenes.view_set import ViewSet

GATE = Gate("speed.train.nerf", "speed", "a step", "×", "slower")


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
def machine(monkeypatch: pytest.MonkeyPatch) -> Machine:
    found = Machine()
    monkeypatch.setattr(speed, "kernel", lambda: found.work(0.010))
    return found


def test_a_ratio_is_of_the_kernel_whatever_the_machine_does(machine: Machine) -> None:
    assert speed.ratio(machine.work(0.025), machine.clock) == pytest.approx(2.5)
    machine.load = 7.0
    assert speed.ratio(machine.work(0.025), machine.clock) == pytest.approx(2.5)


def test_a_few_disturbed_repetitions_do_not_count(machine: Machine) -> None:
    calls = 0

    def side() -> None:
        nonlocal calls
        calls += 1
        machine.now += 0.5 if calls % 4 == 0 else 0.025

    assert speed.ratio(side, machine.clock) == pytest.approx(2.5)
    assert calls > SPEED_REPEATS


def test_wasted_work_fails_and_a_little_does_not(machine: Machine) -> None:
    """With limits of a machine that does nothing else; the committed ones have a test of their own."""
    limit = limit_from(GATE, [2.45, 2.5, 2.55, 2.52, 2.48, 2.5, 2.47, 2.53], 66)

    def status(seconds: float) -> str:
        return judged(GATE, Sample([speed.ratio(machine.work(seconds), machine.clock)]), limit, "").status

    assert status(0.025) == "pass"
    assert status(0.030) == "pass", "within the margin for other processors"
    assert status(0.0125) == "pass", "faster is welcome"
    # every step done twice
    assert status(0.050) == "fail"


@pytest.mark.parametrize("gate", [gate for gate in gates() if gate.kind == "speed"], ids=lambda gate: gate.name)
def test_the_committed_limits_find_the_factor_that_they_state_and_pass_the_margin(gate: Gate, machine: Machine) -> None:
    """The factor is what measurements of a machine allow: a busy one's let a step done twice pass."""
    limit = read_limits(Path(__file__).parents[3] / LIMITS).limits[gate.name]
    assert limit.centre is not None
    assert limit.detects is not None
    sound = 0.010 * limit.centre

    def status(factor: float) -> str:
        seconds = factor * sound
        return judged(gate, Sample([speed.ratio(machine.work(seconds), machine.clock)]), limit, "").status

    assert status(1.0) == status(SPEED_MARGIN) == "pass"
    assert status(limit.detects) == "fail"


def test_each_gate_has_something_to_measure(ball: ViewSet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "STEPS_BEFORE", 2)
    for name in ("speed.train.qnerf", "speed.render.nerf", "speed.score"):
        side = speed.side_of(name, ball)
        side()
        side()


def test_the_kernel_gives_a_finite_number() -> None:
    assert 0 < float(speed.kernel()()) < float("inf")  # type: ignore[arg-type]
