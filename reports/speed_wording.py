"""Figures of a speed run in words: value with unit, spread, and by how much a target is met or missed."""

import math

from harness.speed_record import Measurement
from reports.wording import NARROW, after, count, figure, number, significant

SMALL_FACTOR = 2.0
"""Up to here a distance from the target is a percentage, beyond it a factor."""


def spread(one: Measurement) -> str:
    """`7.11–7.63×`, or nothing where it was not repeated."""
    if one.low is None or one.high is None or one.value is None:
        return ""
    if one.repeats < 2 and one.low == one.high:
        return ""
    join = " to " if min(one.low, one.high) < 0 else "–"
    return f"{figure(one.low)}{join}{figure(one.high)}{after(one.unit)}"


def target(one: Measurement) -> str:
    """`≥ 10×`: without digits that nobody asked for."""
    if one.target is None:
        return ""
    short = f"{one.target:.6g}"
    text = count(round(one.target)) if float(short).is_integer() else short if "e" not in short else figure(one.target)
    return f"{'≥' if one.sense == 'at_least' else '≤'} {text}{after(one.unit)}"


def outcome(one: Measurement) -> str:
    """`met, 12 % above`, `missed by 6.9 points`, `no figure, so not met`; nothing without a target."""
    if one.target is None:
        return ""
    if one.value is None:
        return "no figure, so not met"
    if one.value == one.target:
        return "met exactly"
    return _met(one.value, one.target, one) if one.met else f"missed{_shortfall(one.value, one.target, one.unit)}"


def _met(value: float, goal: float, one: Measurement) -> str:
    side = "above" if value > goal else "below"
    if one.unit == "%":
        return f"met, {_points(value - goal)} {side}"
    factor = _factor(value, goal)
    if factor is None:
        return "met"
    if factor > SMALL_FACTOR:
        return f"met, {significant(factor, 2)}× {'the target' if value > goal else 'below it'}"
    return f"met, {_share(value, goal)} {side}"


def _shortfall(value: float, goal: float, unit: str) -> str:
    if unit == "%":
        return f" by {_points(value - goal)}"
    factor = _factor(value, goal)
    if factor is None:
        return ""
    return f" by a factor of {significant(factor, 2)}" if factor > SMALL_FACTOR else f" by {_share(value, goal)}"


def in_repetitions(one: Measurement) -> str:
    """Where the spread straddles the target: the median alone says too little."""
    if one.target is None or one.met is None or one.low is None or one.high is None:
        return ""
    worst, best = (one.low, one.high) if one.sense == "at_least" else (one.high, one.low)
    reached = [(edge >= one.target if one.sense == "at_least" else edge <= one.target) for edge in (worst, best)]
    if one.met and not reached[0]:
        return "not in every repetition"
    if not one.met and reached[1]:
        return "reached in the best repetition"
    return ""


def _factor(value: float, goal: float) -> float | None:
    """How many times the larger is the smaller."""
    small, large = sorted((value, goal))
    return large / small if small > 0 and math.isfinite(large / small) else None


def _share(value: float, goal: float) -> str:
    return f"{_two_digits(100 * abs(value - goal) / goal)}{NARROW}%"


def _points(difference: float) -> str:
    return f"{_two_digits(abs(difference))} points"


def _two_digits(value: float) -> str:
    return significant(value, 2) if value < 10 else number(value, 0)
