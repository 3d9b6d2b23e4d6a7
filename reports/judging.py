"""Verdicts on printed numbers: pure functions of figures and intervals.

A gain is a level. At the paper's scale it is *reproduced* where the interval of what was measured lies above 0 and
within `margin` of what is printed, and *not reproduced* where it lies outside. At another scale it can only be *seen*,
where the interval lies above 0 and reaches to within `margin` of what is printed, or *not seen at this scale*, where it
does not reach there. All else is *inconclusive*. A printed sum is judged by the figures that it is made of.
"""

import math
from collections.abc import Iterable
from statistics import NormalDist

from harness.statistics import critical
from reports.ledger import Number, Pair
from reports.wording import Verdict

MARGINS = {"psnr": 0.2, "ssim": 0.005}
"""How near a level must come: the smallest differences of interest, as the harness declares them."""
LEAST_PAIRS = 3
"""Two seeds give no verdict."""
POWER = 0.8
MOST_SEEDS = 1000


def half_unit(printed: Number, unit: str = "") -> float:
    """Half of the last printed digit: what may have been rounded away. 1.4 → 0.05, 257 → 0.5, 67 000 → 500.

    dB and hours are printed with one decimal, also where it is 0.
    """
    if unit in ("dB", "h"):
        return 0.05
    if isinstance(printed, int) or float(printed).is_integer():
        digits = str(abs(int(printed)))
        zeros = len(digits) - len(digits.rstrip("0")) if digits != "0" else 0
        return 0.5 * 10**zeros
    decimals = len(repr(float(printed)).split(".")[1])
    return 0.5 * 10**-decimals


def judge_gain(printed: float, margin: float, measured: Pair | None, at_paper_scale: bool) -> Verdict:
    """A printed gain against the interval of the measured one; without an interval nothing is settled."""
    if measured is None:
        return "inconclusive"
    low, high = measured
    least, most = max(0.0, printed - margin), printed + margin
    if high < least or low > most:
        return "not reproduced" if at_paper_scale else "not seen at this scale"
    if low <= 0:
        return "inconclusive"
    if at_paper_scale:
        return "reproduced" if least <= low and high <= most else "inconclusive"
    return "seen"


def judge_level(printed: float, margin: float, measured: Pair | None) -> Verdict:
    """A printed level, at the paper's scale alone: within `margin` of it, outside, or neither."""
    if measured is None:
        return "inconclusive"
    low, high = measured
    if high < printed - margin or low > printed + margin:
        return "not reproduced"
    return "reproduced" if printed - margin <= low and high <= printed + margin else "inconclusive"


def judge_all(parts: Iterable[Verdict]) -> Verdict:
    """A statement about each of several things: refuted by one, reproduced by all."""
    found = set(parts)
    if "not reproduced" in found:
        return "not reproduced"
    return "reproduced" if found == {"reproduced"} else "inconclusive"


def seeds_that_settle(deviation: float, scenes: int, margin: float, family: int = 1) -> int | None:
    """How many seeds a scene would show a true gain that is just the printed one, in 80 % of repetitions.

    `deviation` is that of a paired difference about its scene's mean. The interval on `scenes` fixed scenes, one of
    `family`, must then fit into ± `margin`. None where a thousand would not do.
    """
    off_centre = NormalDist().inv_cdf((1 + POWER) / 2)
    for seeds in range(LEAST_PAIRS, MOST_SEEDS):
        reach = critical(scenes * (seeds - 1), family) + off_centre
        if reach * deviation / math.sqrt(scenes * seeds) <= margin:
            return seeds
    return None


def judge_figures(printed: float, rounding: float, computed: float, reachable: Pair) -> Verdict:
    """A printed result against what the printed figures give: `computed` from them as they stand, `reachable` from
    all that rounds to them.

    *reproduced* where `computed` rounds to the printed result, *not reproduced* where nothing reachable does, and
    *inconclusive* where only the rounding of the figures could explain it.
    """
    slack = 1e-9 * max(1.0, abs(printed))  # decimals are no binary fractions
    if abs(computed - printed) <= rounding + slack:
        return "reproduced"
    missed = reachable[1] < printed - rounding - slack or reachable[0] > printed + rounding + slack
    return "not reproduced" if missed else "inconclusive"
