"""Seconds of things that are compared, taken in turn, and figures with their spread made of them."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Literal

from harness.speed_record import Measurement

Seconds = dict[str, list[float]]
"""Side → seconds of one call, one entry a repetition."""


def interleaved(
    sides: Mapping[str, Callable[[], object]],
    repeats: int,
    synchronise: Callable[[], object] = lambda: None,
    least_seconds: float = 0.0,
    clock: Callable[[], float] = time.perf_counter,
    before: Mapping[str, Callable[[], object]] | None = None,
) -> Seconds:
    """Seconds of a call of each side, A B A B …, after one call of each that does not count.

    A side that is faster than `least_seconds` is called as often as fills them, and the mean of these calls counts.
    `before` prepares a side, off the clock.
    """
    prepared = before or {}
    calls: dict[str, int] = {}
    for name, side in sides.items():
        prepared.get(name, _nothing)()
        side()  # allocations, choices of kernels, caches
        once = _seconds(side, 1, synchronise, clock)
        calls[name] = max(1, round(least_seconds / max(once, 1e-9)))
    taken: Seconds = {name: [] for name in sides}
    for _ in range(repeats):
        for name, side in sides.items():
            prepared.get(name, _nothing)()
            taken[name].append(_seconds(side, calls[name], synchronise, clock) / calls[name])
    return taken


def _nothing() -> None:
    pass


def _seconds(
    side: Callable[[], object], calls: int, synchronise: Callable[[], object], clock: Callable[[], float]
) -> float:
    synchronise()
    began = clock()
    for _ in range(calls):
        side()
    synchronise()
    return clock() - began


def quotients(slow: Sequence[float], fast: Sequence[float]) -> list[float]:
    """How many times faster, repetition by repetition: what disturbs the machine for a while disturbs both."""
    return [a / b for a, b in zip(slow, fast, strict=True)]


def measured(
    id: str,
    item: int,
    title: str,
    values: Sequence[float],
    unit: str,
    *,
    target: float | None = None,
    sense: Literal["at_least", "at_most"] = "at_least",
    detail: str = "",
) -> Measurement:
    """Median, smallest and largest of at least one repetition."""
    return Measurement(
        id=id,
        item=item,
        title=title,
        value=statistics.median(values),
        unit=unit,
        low=min(values),
        high=max(values),
        repeats=len(values),
        target=target,
        sense=sense,
        detail=detail,
    )


def not_measured(
    id: str, item: int, title: str, unit: str, why: str, *, target: float | None = None, repeats: int = 0
) -> Measurement:
    """What has no value, and why."""
    return Measurement(id=id, item=item, title=title, value=None, unit=unit, repeats=repeats, target=target, detail=why)
