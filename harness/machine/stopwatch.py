"""Training seconds of one method: only the time between `start` and `stop` counts."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import torch


class Stopwatch:
    """A stopwatch of wall seconds that waits for launched work before each reading."""

    def __init__(self, device: torch.device, clock: Callable[[], float] = time.perf_counter) -> None:
        self._synchronise = torch.cuda.synchronize if device.type == "cuda" else _nothing
        self._clock = clock
        self.seconds = 0.0

    @contextmanager
    def running(self) -> Iterator[None]:
        self._synchronise()
        began = self._clock()
        try:
            yield
        finally:
            self._synchronise()
            self.seconds += self._clock() - began


def _nothing() -> None:
    pass
