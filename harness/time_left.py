"""How long what goes on will still take, from what of it is finished; nothing is said before anything is."""

import heapq
import time

UNITS = ((86400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
ENOUGH = 0.25
"""Share of a piece of work after which its pace says something of the rest."""
SPREAD = (0.7, 1.4)
"""The rest takes as many times as long as at the pace of what was done: of a group of cells, whose first steps leave no
empty space out, and of scenes, which differ by so much (`docs/reduced/summary.json`)."""


def span(low: float, high: float) -> str:
    """Seconds in words, no more exact than they are known: `40 to 70 s`, `13 to 24 min`, `about 3 h`."""
    size, unit = next((one for one in UNITS if high >= 1.5 * one[0]), UNITS[-1])
    ends = [_rounded(value / size) for value in (low, high)]
    return f"about {ends[0]} {unit}" if ends[0] == ends[1] else f"{ends[0]} to {ends[1]} {unit}"


def _rounded(value: float) -> str:
    """Halves below 4.5, whole numbers below 20, else multiples of five."""
    if value < 4.5:
        return f"{round(2 * value) / 2:g}"
    return f"{value:.0f}" if value < 20 else f"{5 * round(value / 5)}"


def in_turn(rests: list[float], workers: int, waiting: int, each: float) -> float:
    """Seconds until `workers` have ended what they are at, of which `rests` are left, and after that `waiting` pieces
    of `each`; no piece is divided, so that in the end some have nothing to do."""
    ends = sorted([*rests, *[0.0] * (workers - len(rests))])
    for _ in range(waiting):
        heapq.heapreplace(ends, ends[0] + each)
    return max(ends, default=0.0)


class TimeLeft:
    """At the pace since the first report, which comes after processes have started and data are read."""

    def __init__(self) -> None:
        self._first: tuple[float, float] | None = None

    def words(self, done: float, enough: bool, kept: float | None = None, at_least: float = 0.0) -> str:
        """`done` of the whole, 0 to 1; empty where that is not `enough` to tell the rest by, or nothing is left.

        `kept` of it took none of this time (what was done at the first report, if not given); at its pace the rest
        takes `at_least` so many seconds.
        """
        now = time.monotonic()
        if self._first is None:
            self._first = now, done
        seconds, more = now - self._first[0], done - (self._first[1] if kept is None else kept)
        if not enough or seconds <= 0 or more <= 0 or done >= 1:
            return ""
        left = max(seconds * (1 - done) / more, at_least)
        return f"{span(SPREAD[0] * left, SPREAD[1] * left)} left"
