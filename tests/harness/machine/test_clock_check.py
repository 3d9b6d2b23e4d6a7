"""The check of the clock, on made-up clocks: a sound one passes, and each fault is found where it shows."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest
import torch

from harness.machine import clock_check
from harness.machine.clock_check import TOLERATED, Clocks, clock_errors, noise, spinning, system_clocks
from harness.machine.stopwatch import Stopwatch


class Machine:
    """A machine whose time passes only while something is done."""

    def __init__(self) -> None:
        self.wall = self.cores = 0.0

    def sleep(self, seconds: float) -> None:
        self.wall += seconds

    def work(self, seconds: float) -> None:
        self.wall += seconds
        self.cores += seconds


def errors(
    wall: Callable[[float], float] = lambda now: now,
    cores: Callable[[Machine], float] = lambda machine: machine.cores,
    watch: type[Stopwatch] = Stopwatch,
) -> dict[str, float]:
    """What the check says of a stopwatch that reads the machine's time by `wall` and `cores`."""
    machine = Machine()

    def made() -> Stopwatch:
        return watch(torch.device("cpu"), lambda: wall(machine.wall), lambda: cores(machine))

    return clock_errors(Clocks(lambda: machine.wall, lambda: machine.cores, machine.sleep, machine.work, made))


class NeverStops(Stopwatch):
    """Counts from its first start to its last stop."""

    first = None

    def running(self):  # type: ignore[no-untyped-def]
        if self.first is None:
            self.first = self._clock()
        context = super().running()
        watch = self

        class Both:
            def __enter__(self) -> None:
                context.__enter__()

            def __exit__(self, *_: object) -> None:
                context.__exit__(None, None, None)
                watch.seconds = watch._clock() - watch.first

        return Both()


def test_a_sound_clock_is_right_to_the_last_digit() -> None:
    assert errors() == dict.fromkeys(("a sleep", "a busy loop", "a slow evaluation"), 0.0)


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"wall": lambda now: 1.05 * now}, {"a sleep", "a busy loop", "a slow evaluation"}),
        ({"cores": lambda machine: machine.wall}, {"a sleep"}),
        ({"cores": lambda machine: 0.5 * machine.cores}, {"a busy loop"}),
        ({"watch": NeverStops}, {"a slow evaluation"}),
    ],
    ids=["it runs fast", "a sleep counts as work", "half of the work", "an evaluation counts"],
)
def test_each_fault_is_found_where_it_shows(changes: dict[str, object], found: set[str]) -> None:
    assert {load for load, error in errors(**changes).items() if error > TOLERATED} == found


def test_this_systems_clocks_are_what_they_are_held_against() -> None:
    clocks = system_clocks()
    wall, cores = clocks.wall(), clocks.cores()
    clocks.work(0.05)
    assert clocks.wall() - wall >= 0.049
    assert clocks.cores() - cores >= 0.049


def test_noise_is_the_spread_of_the_same_work_and_its_waits() -> None:
    machine, lengths = Machine(), iter([9.0, *(1.0 + 0.01 * number for number in range(9))])

    def work() -> None:
        machine.work(next(lengths))
        machine.sleep(0.26)

    watch = Stopwatch(torch.device("cpu"), lambda: machine.wall, lambda: machine.cores)
    spread, waits = noise(watch, work, repeats=9)
    assert spread == pytest.approx(0.04 / 1.04), "of 1.00, 1.01 … 1.08, not of the first, which imports"
    assert waits == pytest.approx(0.26 / 1.04)


@pytest.mark.parametrize(("spins", "times"), [(True, 7.0), (False, 1.0)])
def test_threads_that_spin_beside_busy_programs_are_told_by_their_core_seconds(
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
        machine.work(0.1 * (1.0 + waiting))

    monkeypatch.setattr(clock_check, "layers", layers)
    watch = Stopwatch(torch.device("cpu"), lambda: machine.wall, lambda: machine.cores)
    assert spinning(watch, 2, busy) == pytest.approx(times)
    assert others == [0]
    assert torch.get_num_threads() == 1
