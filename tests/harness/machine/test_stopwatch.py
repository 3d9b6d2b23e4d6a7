"""What is between start and stop counts, and nothing else."""

import time
from collections.abc import Iterator

import pytest
import torch

from harness.machine.stopwatch import Stopwatch


class FakeClock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_what_is_outside_does_not_count() -> None:
    clock = FakeClock()
    processor = FakeClock()
    watch = Stopwatch(torch.device("cpu"), clock, processor)
    clock.now += 1000
    processor.now += 2000
    with watch.running():
        clock.now += 2
        processor.now += 3.5
    clock.now += 5000
    processor.now += 10000
    with watch.running():
        clock.now += 0.5
        processor.now += 1
    clock.now += 1
    assert (watch.seconds, watch.core_seconds) == (2.5, 4.5)


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


def test_a_step_that_fails_still_counts() -> None:
    clock = FakeClock()
    watch = Stopwatch(torch.device("cpu"), clock)

    def step() -> None:
        with watch.running():
            clock.now += 3
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        step()
    assert watch.seconds == 3


def test_launched_work_is_waited_for_before_each_reading(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = FakeClock()
    pending = [7.0, 11.0]  # of somebody else before the step, and of the step

    def synchronize() -> None:
        clock.now += pending.pop(0)

    monkeypatch.setattr(torch.cuda, "synchronize", synchronize)
    watch = Stopwatch(torch.device("cuda"), clock)
    with watch.running():
        clock.now += 1
    assert pending == []
    assert watch.seconds == 12


def test_the_time_to_make_items_counts_and_not_what_is_done_with_them() -> None:
    now = 0.0

    def items() -> Iterator[str]:
        nonlocal now
        for name in "abc":
            now += 2.0
            yield name
        now += 0.5

    watch = Stopwatch(torch.device("cpu"), lambda: now, lambda: 3 * now)
    for _ in watch.counting(items()):
        now += 100.0
    assert (watch.seconds, watch.core_seconds) == (6.5, 19.5)
