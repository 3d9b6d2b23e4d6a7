"""Seconds of single calls, and what is said of many of them. The clock is handed in, so that tests need no time."""

import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from harness.serving_record import Latency, Pair, Timed

One = TypeVar("One")
Clock = Callable[[], float]
"""Seconds that only ever grow."""

CLOCK: Clock = time.perf_counter


def timed(call: Callable[[], One], clock: Clock = CLOCK) -> tuple[One, float]:
    """What a call gives, and its seconds. Whatever is rendered here ends as an array in memory, so that a device has
    finished by then.
    """
    began = clock()
    found = call()
    return found, clock() - began


def latency(
    scene: str, method: str, source: Timed, seconds: Sequence[float], rendering: Sequence[float] | None = None
) -> Latency:
    """Median and spread of calls and, against those of `rendering`, how many times as long rendering takes.

    Raises `ValueError` for no calls, and for seconds that are not positive: the clock is too coarse for them.
    """
    ratio, ratio_spread = None, None
    if rendering is not None:
        ratio = _quantile(rendering, 0.5) / _quantile(seconds, 0.5)
        ratio_spread = (
            _quantile(rendering, 0.25) / _quantile(seconds, 0.75),
            _quantile(rendering, 0.75) / _quantile(seconds, 0.25),
        )
    spread: Pair = (_quantile(seconds, 0.05), _quantile(seconds, 0.95))
    return Latency(scene, method, source, _quantile(seconds, 0.5), spread, len(seconds), ratio, ratio_spread)


def _quantile(seconds: Sequence[float], share: float) -> float:
    values = np.asarray(seconds, dtype=np.float64)
    if not len(values):
        raise ValueError("no call was timed")
    if not bool((values > 0.0).all()):
        raise ValueError(f"{float(values.min())} s for a call: the clock is too coarse, or ran backwards")
    return float(np.quantile(values, share))
