"""Which order of rendering gets there first: the whole picture and parts of it, by scene, method and map."""

import math
from dataclasses import dataclass

from harness.serving_record import Anytime, AttentionRecord, Measure, Order

SHARE = 0.1
"""Of the coarse frame's error: when so little is left, a picture is called useful."""
ORDERS: tuple[Order, ...] = ("attention", "raster", "spread", "plain")


@dataclass(frozen=True)
class At:
    """Seconds, and the least and the most of the repeats."""

    seconds: float
    least: float
    most: float


Times = dict[Order, At | None]
"""By order; None where an order never gets there."""


@dataclass(frozen=True)
class Race:
    """One picture in all orders that were measured."""

    scene: str
    method: str
    attention: str
    times: dict[Measure, Times]

    def to(self, measure: Measure) -> Times:
        return self.times.get(measure, {})


def races(record: AttentionRecord, share: float = SHARE) -> list[Race]:
    """In the order of the record."""
    known: dict[tuple[str, str, str], dict[Measure, Times]] = {}
    for one in record.reaching:
        if math.isclose(one.share_of_error, share):
            times = known.setdefault((one.scene, one.method, one.attention), {}).setdefault(one.measure, {})
            times[one.order] = None if one.seconds is None or one.spread is None else At(one.seconds, *one.spread)
    return [Race(*name, times) for name, times in known.items()]


def earlier(times: Times, one: Order, other: Order) -> bool:
    """Whether `one` gets there, and `other` never, or later in every repeat than `one` in any."""
    mine, theirs = times.get(one), times.get(other)
    return mine is not None and (theirs is None or mine.most < theirs.least)


def first(times: Times) -> Order | None:
    """The order that gets there before all others; None where none does, or where the repeats leave it undecided."""
    there = [one for one, at in times.items() if at is not None]
    return next((one for one in there if all(earlier(times, one, other) for other in times if other != one)), None)


def mean_error(curve: Anytime, until: float, measure: Measure) -> float | None:
    """Mean over time of an error from the first frame on, until so many seconds: what a viewer sees meanwhile.

    A picture keeps its last error until the next region is done. None where the first frame comes later.
    """
    begin = curve.seconds[0]
    if until <= begin:
        return None
    ends = [*curve.seconds[1:], math.inf]
    spans = [max(0.0, min(end, until) - at) for at, end in zip(curve.seconds, ends, strict=True)]
    return sum(span * value for span, value in zip(spans, curve.rmse(measure), strict=True)) / (until - begin)
