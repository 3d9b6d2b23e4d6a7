"""Does the clock of training count the right seconds, how much do those of the same work differ, and do core seconds of
several threads hold work alone?

The clock is held against other clocks of the system on three known loads; the same matrix multiplications are timed
again and again, and a few layers with one thread and with more while other programs use the cores.
"""

import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

import numpy as np
import torch

from harness.machine.stopwatch import Stopwatch

SECONDS = 0.25
"""The length of each load."""
TOLERATED = 0.02
"""The share of a load by which the clock may be wrong."""
REPEATS = 20
NOISY = 0.05
"""The spread of the same work's core seconds, and the share of the wall seconds that it waits, above which another
program is to be suspected.
"""
SPINNING = 2.0
"""The core seconds of two threads, as a multiple of one thread's for the same work, above which they spin. Threads that
sleep share caches as well, and differ from case to case on a busy machine.
"""
BUSY = "import time\nuntil = time.monotonic() + {seconds}\nwhile time.monotonic() < until:\n    pass"
"""A program that uses a core for so many seconds, and then ends even if nobody is left to end it."""


@dataclass(frozen=True)
class Clocks:
    """The system as the check uses it; tests put other clocks in the place of these."""

    wall: Callable[[], float]
    """Seconds of the wall, from another source than the stopwatch has."""
    cores: Callable[[], float]
    """Processor seconds of this process, likewise."""
    sleep: Callable[[float], None]
    work: Callable[[float], None]
    """Use the processor for so many seconds."""
    watch: Callable[[], Stopwatch]


def _used() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def _work(seconds: float) -> None:
    until = time.thread_time() + seconds
    while time.thread_time() < until:
        pass


def system_clocks() -> Clocks:
    # the raw clock is not steered by network time, as `perf_counter` is; systems without it have the calendar's
    raw = getattr(time, "CLOCK_MONOTONIC_RAW", None)
    wall = time.time if raw is None else lambda: time.clock_gettime(raw)
    return Clocks(wall, _used, time.sleep, _work, lambda: Stopwatch(torch.device("cpu")))


def clock_errors(clocks: Clocks, seconds: float = SECONDS) -> dict[str, float]:
    """Return by load how far the clock of training is wrong, as a share of the load.

    A sleep has seconds of the wall and none of a core; a busy loop has both; and of training with a slow evaluation in
    the middle, the evaluation must not count.
    """
    return {
        "a sleep": _counted(clocks, clocks.sleep, seconds),
        "a busy loop": _counted(clocks, clocks.work, seconds),
        "a slow evaluation": _beside(clocks, seconds),
    }


def noise(watch: Stopwatch, work: Callable[[], object], repeats: int = REPEATS) -> tuple[float, float]:
    """Time the same work again and again. Returns the range of the middle half of its core seconds as a share of their
    median, and the wall seconds of all per core second less 1.
    """
    work()  # the first time loads what it needs
    wall, cores = watch.seconds, watch.core_seconds
    each = [_core_seconds(watch, work) for _ in range(repeats)]
    low, middle, high = np.quantile(each, (0.25, 0.5, 0.75))
    return float((high - low) / middle), (watch.seconds - wall) / (watch.core_seconds - cores) - 1.0


def _core_seconds(watch: Stopwatch, work: Callable[[], object]) -> float:
    before = watch.core_seconds
    with watch.running():
        work()
    return watch.core_seconds - before


def spinning(
    watch: Stopwatch, threads: int, busy: Callable[[int], AbstractContextManager[None]], repeats: int = REPEATS
) -> float:
    """Return the core seconds of `layers` by so many threads as a multiple of those by one, which has nobody to wait
    for: the median of pairs, while as many busy programs as threads run. torch is left with one thread.
    """
    pairs: list[list[float]] = []
    try:
        with busy(threads):
            for _ in range(repeats + 1):
                pairs.append([])
                for count in (1, threads):
                    torch.set_num_threads(count)
                    pairs[-1].append(_core_seconds(watch, layers))
    finally:
        torch.set_num_threads(1)
    # the first pair loads what it needs
    return float(np.median([several / one for one, several in pairs[1:]]))


@contextmanager
def busy_programs(count: int, seconds: float = 10.0) -> Iterator[None]:
    """Run so many programs that use a core each, for so many seconds at most."""
    command = [sys.executable, "-S", "-c", BUSY.format(seconds=seconds)]
    programs = [subprocess.Popen(command) for _ in range(count)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


def layers() -> object:
    """Evaluate a few layers as a training step does: short operations, after each of which threads wait."""
    points, weights = torch.ones(1 << 13, 64), torch.ones(64, 64)
    for _ in range(4):
        points = torch.relu(points @ weights / 64.0)
    return points


def products() -> object:
    """Multiply matrices as large as a training's for some hundredths of a second."""
    points, weights = torch.ones(1 << 15, 64), torch.ones(64, 64)
    for _ in range(10):
        points = points @ weights / 64.0
    return points


def _counted(clocks: Clocks, load: Callable[[float], None], seconds: float) -> float:
    watch = clocks.watch()
    wall, cores = clocks.wall(), clocks.cores()
    with watch.running():
        load(seconds)
    wall, cores = clocks.wall() - wall, clocks.cores() - cores
    return max(abs(watch.seconds - wall), abs(watch.core_seconds - cores)) / wall


def _beside(clocks: Clocks, seconds: float) -> float:
    watch, trained = clocks.watch(), 0.0
    for evaluate in (True, False):
        began = clocks.wall()
        with watch.running():
            clocks.work(seconds / 2)
        trained += clocks.wall() - began
        if evaluate:
            clocks.sleep(seconds)
    return abs(watch.seconds - trained) / seconds
