"""Which order of rendering gets there first: attended regions and the whole picture, by scene, method and map.

Times to the attended error are the record's; those to the error of the whole picture are read off the curves.
"""

import math
from dataclasses import dataclass

from harness.serving_record import Anytime, AttentionRecord, Order

SHARE = 0.1
"""Of the coarse frame's error: when so little is left, a picture is called useful."""
ORDERS: tuple[Order, ...] = ("attention", "raster", "spread")

Times = dict[Order, float | None]
"""Seconds by order; None where an order never gets there."""


@dataclass(frozen=True)
class Race:
    """One picture in all orders that were measured."""

    scene: str
    method: str
    attention: str
    attended: Times
    whole: Times


def races(record: AttentionRecord, share: float = SHARE) -> list[Race]:
    """In the order of the record; those without a time to the attended error are left out."""
    known: dict[tuple[str, str, str], Times] = {}
    for one in record.reaching:
        if math.isclose(one.share_of_error, share):
            known.setdefault((one.scene, one.method, one.attention), {})[one.order] = one.seconds
    return [
        Race(
            *name,
            attended,
            {
                one.order: reached(one.seconds, one.rmse_whole, share)
                for one in record.curves
                if (one.scene, one.method, one.attention) == name
            },
        )
        for name, attended in known.items()
    ]


def reached(seconds: list[float], error: list[float], share: float) -> float | None:
    """When an error has fallen to a share of what it began with, and stays so: as the record's own times are."""
    above = [place for place, value in enumerate(error) if value > share * error[0]]
    place = above[-1] + 1 if above else 0
    return seconds[place] if place < len(seconds) else None


def earlier(times: Times, one: Order, other: Order) -> bool:
    """Whether `one` gets there, and `other` later or never."""
    mine, theirs = times.get(one), times.get(other)
    return mine is not None and (theirs is None or mine < theirs)


def first(times: Times) -> Order | None:
    """The order that gets there before all others; None where none does, or two at once."""
    there = {order: at for order, at in times.items() if at is not None}
    best = min(there.values(), default=math.inf)
    winners = [order for order, at in there.items() if at == best]
    return winners[0] if len(winners) == 1 else None


def mean_error(curve: Anytime, until: float, whole: bool) -> float | None:
    """Mean over time of an error from the coarse frame on, until so many seconds: what a viewer sees meanwhile.

    A picture keeps its last error until the next region is done. None where the coarse frame comes later.
    """
    error = curve.rmse_whole if whole else curve.rmse_attended
    begin = curve.seconds[0]
    if until <= begin:
        return None
    ends = [*curve.seconds[1:], math.inf]
    spans = [max(0.0, min(end, until) - at) for at, end in zip(curve.seconds, ends, strict=True)]
    return sum(span * value for span, value in zip(spans, error, strict=True)) / (until - begin)
