"""Only time inside `running` counts; noise and spinning are found, on a simulated machine."""

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest
import torch

from harness.machine import clock_check
from harness.machine.clock_check import noise, spinning
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


def test_noise_is_the_spread_of_the_same_work_and_its_waits() -> None:
    machine, lengths = Machine(), iter([9.0, *(1.0 + 0.01 * number for number in range(9))])
    spread, waits = noise(machine.watch, lambda: machine.work(0.26 + (length := next(lengths)), length), repeats=9)
    assert spread == pytest.approx(0.04 / 1.04), "of 1.00, 1.01 … 1.08, not of the first, which imports"
    assert waits == pytest.approx(0.26 / 1.04)


@pytest.mark.parametrize(("spins", "times"), [(True, 7.0), (False, 1.0)])
def test_threads_that_spin_next_to_busy_programs_are_found_by_their_core_seconds(
    monkeypatch: pytest.MonkeyPatch, spins: bool, times: float
) -> None:
    machine, others = Machine(), [0]

    @contextmanager
    def busy(count: int) -> Iterator[None]:
        others[0] = count
        yield
        others[0] = 0

    def layers() -> None:
        waiting = 3.0 * others[0] * (torch.get_num_threads() - 1) if spins else 0.0
        machine.work(1.0, 0.1 * (1.0 + waiting))

    monkeypatch.setattr(clock_check, "layers", layers)
    assert spinning(machine.watch, 2, busy) == pytest.approx(times)
    assert others == [0]
    assert torch.get_num_threads() == 1
