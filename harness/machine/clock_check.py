"""Checks of this machine's clocks: the spread of the same work's core seconds, and whether waiting counts as work."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import numpy as np
import torch

from harness.machine.stopwatch import Stopwatch

REPEATS = 20
NOISY = 0.05
"""The limits of the spread of the same work's core seconds, and of the share of the wall seconds that it waits."""
SPINNING = 2.0
"""The core seconds of two threads, as a multiple of one thread's for the same work, above which they spin. Threads that
sleep share caches as well, and differ from case to case on a busy machine.
"""
BUSY = "import time\nuntil = time.monotonic() + {seconds}\nwhile time.monotonic() < until:\n    pass"
"""A program that uses a core for a given time, and then ends even if the process that started it is gone."""


def noise(watch: Stopwatch, work: Callable[[], object], repeats: int = REPEATS) -> tuple[float, float]:
    """Time the same work repeatedly. Returns the range of the middle half of its core seconds as a share of their
    median, and the wall seconds of all per core second less 1.
    """
    work()  # the first time loads what it needs
    wall, cores = watch.seconds, watch.core_seconds
    each = [_core_seconds(watch, work) for _ in range(repeats)]
    low, middle, high = np.quantile(each, (0.25, 0.5, 0.75))
    return float((high - low) / middle), (watch.seconds - wall) / (watch.core_seconds - cores) - 1.0


def spinning(watch: Stopwatch, threads: int, busy: Callable[[int], AbstractContextManager[None]]) -> float:
    """Return the core seconds of `layers` by `threads` threads as a multiple of those by one, which never waits: the
    median of pairs, while `threads` busy programs run. torch is left with one thread.
    """
    pairs: list[list[float]] = []
    try:
        with busy(threads):
            for _ in range(REPEATS + 1):
                pairs.append([])
                for count in (1, threads):
                    torch.set_num_threads(count)
                    pairs[-1].append(_core_seconds(watch, layers))
    finally:
        torch.set_num_threads(1)
    # the first pair loads what it needs
    return float(np.median([several / single for single, several in pairs[1:]]))


@contextmanager
def busy_programs(count: int, seconds: float = 10.0) -> Iterator[None]:
    command = [sys.executable, "-S", "-c", BUSY.format(seconds=seconds)]
    programs = [subprocess.Popen(command) for _ in range(count)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


def layers() -> object:
    """Evaluate a few layers as a training step does: short operations, each followed by a wait of the threads."""
    points, weights = torch.ones(1 << 13, 64), torch.ones(64, 64)
    for _ in range(4):
        points = torch.relu(points @ weights / 64.0)
    return points


def multiplications() -> object:
    """Multiply matrices of the size of a training's for some hundredths of a second."""
    points, weights = torch.ones(1 << 15, 64), torch.ones(64, 64)
    for _ in range(10):
        points = points @ weights / 64.0
    return points


def _core_seconds(watch: Stopwatch, work: Callable[[], object]) -> float:
    before = watch.core_seconds
    with watch.running():
        work()
    return watch.core_seconds - before
