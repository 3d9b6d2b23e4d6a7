"""When a curve of PSNR over seconds reaches a target, and for good: arithmetic alone, nothing is trained here."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field


@dataclass
class Curve:
    """Evaluations of one training, in the order of its own clock."""

    seconds: list[float] = field(default_factory=list)
    psnr: list[float] = field(default_factory=list)
    """dB."""
    before: float = -math.inf
    """dB of the first weights: a target below it says nothing about training."""
    ended: str = ""
    """Why it went no further, where that was not its budget."""

    def add(self, seconds: float, psnr: float) -> None:
        self.seconds.append(seconds)
        self.psnr.append(psnr)


@dataclass(frozen=True)
class Target:
    """The best that the plain training had reached at a share of its budget, and when it first did."""

    share: float
    psnr: float
    seconds: float


def targets_of(plain: Curve, shares: tuple[float, ...]) -> list[Target]:
    """One target a share, from evaluations that are evenly spread over the budget. A share before the first evaluation
    takes that one.
    """
    found = []
    for share in shares:
        count = max(1, round(share * len(plain.psnr)))
        best = max(range(count), key=lambda index: plain.psnr[index])
        found.append(Target(share, plain.psnr[best], plain.seconds[best]))
    return found


def reached(curve: Curve, target: float) -> float | None:
    """Seconds at which `target` is reached, or None.

    It counts once the next evaluation holds it too. Between an evaluation below and one above, PSNR is taken to be
    linear in log seconds; a first evaluation that is above already counts with its own seconds.
    """
    for index in range(len(curve.psnr) - 1):
        above, next_one = curve.psnr[index], curve.psnr[index + 1]
        if above < target or next_one < target:
            continue
        if index == 0:
            return curve.seconds[index]
        below = curve.psnr[index - 1]  # it is: were it not, the search would have ended there
        share = (target - below) / (above - below)
        first, second = math.log(curve.seconds[index - 1]), math.log(curve.seconds[index])
        return math.exp(first + share * (second - first))
    return None


def evaluation_times(first: float, growth: float = 1.06) -> Iterator[float]:
    """Seconds at which to evaluate: each a constant factor after the one before, so that a crossing is found within
    that factor.
    """
    due = first
    while True:
        yield due
        due *= growth


def even_times(budget: float, count: int) -> list[float]:
    """`count` seconds, the last of which is the budget."""
    return [budget * (index + 1) / count for index in range(count)]
