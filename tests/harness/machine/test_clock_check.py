"""Noise and spinning on a simulated machine, whose time passes only during work."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import torch

from harness.machine import clock_check
from harness.machine.clock_check import noise, spinning
from tests.harness.machine.test_stopwatch import Machine


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
