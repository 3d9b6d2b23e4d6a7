"""Wall seconds of a run by phase; for a resumed run, the sums over its processes."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager


class Phases:
    """The phases of this process, counted from the construction, and those `before` it."""

    def __init__(self, before: Mapping[str, float], now: Callable[[], float] = time.monotonic) -> None:
        self._before = dict(before)
        self._now = now
        self._began = now()
        self._ended: dict[str, float] = {}

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Time a phase, even if it is interrupted."""
        began = self._now()
        try:
            yield
        finally:
            self._ended[name] = self._now() - began

    def seconds(self) -> dict[str, float]:
        """Return phase → wall seconds of the phases that have ended; `total` up to now."""
        here = {**self._ended, "total": self._now() - self._began}
        return {name: self._before.get(name, 0.0) + here.get(name, 0.0) for name in {**here, **self._before}}
