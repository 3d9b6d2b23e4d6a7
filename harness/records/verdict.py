"""A verdict on a difference: its sign, its size, and the phrase for both."""

from collections.abc import Iterable
from typing import Literal

from harness.records.json_record import Record

Sign = Literal["above 0", "below 0", "open"]
Size = Literal["matters", "smaller than matters", "open"]


class Verdict(Record, frozen=True):
    """What an interval says about a difference `method` − `against`; whether that is good depends on the metric."""

    sign: Sign
    size: Size
    """The size compared with the smallest effect of interest, the margin, in either direction."""

    @property
    def phrase(self) -> str:
        """Return sign and size as they are printed: `above 0, smaller than matters`, `sign open, matters`, …"""
        if self == OPEN:
            return "sign and size open"
        sign = "sign open" if self.sign == "open" else self.sign
        return f"{sign}, {'size open' if self.size == 'open' else self.size}"

    @property
    def turned(self) -> "Verdict":
        """Return the verdict on `against` − `method`."""
        return Verdict(TURNED[self.sign], self.size)


OPEN = Verdict("open", "open")
TURNED: dict[Sign, Sign] = {"above 0": "below 0", "below 0": "above 0", "open": "open"}


def common(verdicts: Iterable[Verdict]) -> Verdict:
    """Return the sign and the size that all verdicts share; one on which they differ is open."""
    verdicts = list(verdicts)
    signs, sizes = {verdict.sign for verdict in verdicts}, {verdict.size for verdict in verdicts}
    return Verdict(signs.pop() if len(signs) == 1 else "open", sizes.pop() if len(sizes) == 1 else "open")


def phrase_with(verdict: Verdict, interval: tuple[float, float] | None) -> str:
    """Return the phrase; an open verdict whose interval excludes 0 comes from too few seeds."""
    one_sided = interval is not None and (interval[0] > 0 or interval[1] < 0)
    return "too few seeds for a verdict" if verdict == OPEN and one_sided else verdict.phrase


def verdict_of(interval: tuple[float, float] | None, margin: float) -> Verdict:
    """Return the verdict that an interval allows, with `margin` ≥ 0 in its unit; both answers are open without one.

    sign    above or below 0 if the whole interval is
    size    "smaller than matters" if the interval lies within (−margin, margin), "matters" if it lies entirely beyond
            one of the two; with a margin of 0 the size stays open
    """
    if interval is None:
        return OPEN
    low, high = interval
    sign: Sign = "above 0" if low > 0 else "below 0" if high < 0 else "open"
    size: Size = "open"
    if margin > 0 and -margin < low and high < margin:
        size = "smaller than matters"
    elif margin > 0 and (low > margin or high < -margin):
        size = "matters"
    return Verdict(sign, size)
