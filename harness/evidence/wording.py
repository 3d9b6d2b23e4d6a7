"""Figures in the sentences of the studies."""

from collections.abc import Iterable

from harness.comparisons import METRICS
from harness.evidence_record import Effect

UNITS = {"psnr": " dB", "delta_e": "", "depth_rmse": " scene units"}
DIGITS = {"psnr": 2, "delta_e": 2}
NO_FIGURE = "no figure"


def amount(value: float | None, metric: str, sign: bool = True) -> str:
    """`+0.81 dB`, with a true minus sign."""
    if value is None:
        return NO_FIGURE
    digits = DIGITS.get(metric, 3)
    return _number(value, digits, sign) + UNITS.get(metric, "")


def told(one: Effect, gain: bool = True) -> str:
    """`+0.81 dB (95 % interval +0.52 to +1.10: better)`; the interval is the one that the verdict is taken from.

    Without `gain`, as for an interaction, more is not better but above 0.
    """
    aside = f", {one.unpaired} of {one.unpaired + one.pairs} pairs without a score" if one.unpaired else ""
    if one.difference is None or one.simultaneous is None:
        return f"{amount(one.difference, one.metric)} (no interval{aside})"
    digits = DIGITS.get(one.metric, 3)
    low, high = (_number(end, digits, True) for end in one.simultaneous)
    kind = "95 % interval" if one.family == 1 else f"95 % interval, {one.family} together,"
    return f"{amount(one.difference, one.metric)} ({kind} {low} to {high}: {said(one, gain)}{aside})"


def short(one: Effect) -> str:
    """`+0.81 [+0.52, +1.10]`, for a cell of a table: no unit, no verdict; the interval is the verdict's."""
    digits = DIGITS.get(one.metric, 3)
    if one.difference is None:
        return NO_FIGURE
    ends = [_number(end, digits, True) for end in one.simultaneous or ()]
    return _number(one.difference, digits, True) + (f" [{', '.join(ends)}]" if ends else "")


def said(one: Effect, gain: bool = True) -> str:
    """The verdict in words."""
    interest = METRICS[one.metric].smallest_of_interest
    if one.verdict == "equivalent":
        return f"within ±{interest}{UNITS.get(one.metric, '')}"
    if one.verdict == "inconclusive":
        return "not settled"
    if gain:
        return one.verdict
    return "above 0" if (one.difference or 0.0) > 0 else "below 0"


def listed(parts: Iterable[str]) -> str:
    """`a, b and c`"""
    *first, last = parts
    return f"{', '.join(first)} and {last}" if first else last


def _number(value: float, digits: int, sign: bool) -> str:
    text = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    if float(text) == 0:
        text = text.lstrip("+-")
    return text.replace("-", "−")
