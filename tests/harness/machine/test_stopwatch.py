"""Only time inside `running` counts."""

import time
from collections.abc import Iterator
from contextlib import suppress

import pytest
import torch

from harness.machine.stopwatch import Stopwatch


class Machine:
    """A simulated machine whose time passes only during work."""

    def __init__(self, device: str = "cpu") -> None:
        self.wall, self.cores = 100.0, 200.0
        self.watch = Stopwatch(torch.device(device), lambda: self.wall, lambda: self.cores)

    def work(self, wall: float, cores: float = 0.0) -> None:
        self.wall += wall
        self.cores += cores


def test_time_outside_does_not_count_and_a_failing_step_does() -> None:
    machine = Machine()
    machine.work(1000.0, 2000.0)
    with machine.watch.running():
        machine.work(2.0, 3.5)
    machine.work(5000.0, 10000.0)
    with suppress(ZeroDivisionError), machine.watch.running():
        machine.work(0.5, 1.0)
        raise ZeroDivisionError
    machine.work(1.0)
    assert (machine.watch.seconds, machine.watch.core_seconds) == (2.5, 4.5)


def test_the_clocks_are_of_the_wall_and_of_the_processor() -> None:
    watch = Stopwatch(torch.device("cpu"))
    with watch.running():
        began = time.process_time()
        while time.process_time() - began < 0.02:
            pass
    assert watch.core_seconds >= 0.02
    spent = watch.core_seconds
    with watch.running():
        time.sleep(0.05)
    assert watch.core_seconds - spent < 0.05 < watch.seconds


def test_each_reading_waits_for_launched_work(monkeypatch: pytest.MonkeyPatch) -> None:
    pending = [7.0, 11.0]  # launched before the step, and by the step
    monkeypatch.setattr(torch.cuda, "synchronize", lambda: machine.work(pending.pop(0)))
    machine = Machine("cuda")
    with machine.watch.running():
        machine.work(1.0)
    assert (pending, machine.watch.seconds) == ([], 12.0)


def test_the_time_to_make_items_counts_and_the_time_to_use_them_does_not() -> None:
    machine = Machine()

    def items() -> Iterator[str]:
        for name in "abc":
            machine.work(2.0, 6.0)
            yield name
        machine.work(0.5, 1.5)

    for _ in machine.watch.counting(items()):
        machine.work(100.0)
    assert (machine.watch.seconds, machine.watch.core_seconds) == (6.5, 19.5)
