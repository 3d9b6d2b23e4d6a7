"""Training time of one method, in wall seconds and core seconds: only work inside `running` counts."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import TypeVar

import torch

T = TypeVar("T")


class Stopwatch:
    """A stopwatch of wall `seconds` and `core_seconds`, which waits for launched work before each reading. Core seconds
    are the processor time of all threads of this process, spinning included; on a GPU those of the host.
    """

    def __init__(
        self,
        device: torch.device,
        clock: Callable[[], float] = time.perf_counter,
        core_clock: Callable[[], float] = time.process_time,
    ) -> None:
        self._synchronise = torch.cuda.synchronize if device.type == "cuda" else _nothing
        self._clock = clock
        self._core_clock = core_clock
        self.seconds = 0.0
        self.core_seconds = 0.0

    @contextmanager
    def running(self) -> Iterator[None]:
        self._synchronise()
        began, core_began = self._clock(), self._core_clock()
        try:
            yield
        finally:
            self._synchronise()
            self.seconds += self._clock() - began
            self.core_seconds += self._core_clock() - core_began

    def add(self, seconds: float, core_seconds: float) -> None:
        """Count work that was measured elsewhere."""
        self.seconds += seconds
        self.core_seconds += core_seconds

    def counting(self, items: Iterable[T]) -> Iterator[T]:
        """Yield the items; the time to make each counts, the time to use it does not."""
        source = iter(items)
        while True:
            with self.running():
                made = list(islice(source, 1))
            if not made:
                return
            yield from made


def _nothing() -> None:
    pass
