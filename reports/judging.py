"""Verdicts on printed numbers: pure functions of figures and intervals.

A printed gain *does not hold* where the interval of the measured one ends below everything that rounds to the printed
value, *holds* where it lies at or above that range, and is *inconclusive* where it reaches into it or across it.
A printed level is judged from both sides. A printed sum is judged by the figures that it is made of.
"""

from reports.ledger import UNTESTED, Number, Pair, Printed, Verdict

STUDENT = {1: 12.706, 2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 6: 2.447, 7: 2.365, 8: 2.306, 9: 2.262}
"""Half-width of a 95 % interval in standard errors by degrees of freedom; 1.96 is approached from above."""


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


def rounded_away(entry: Printed) -> float:
    """How far below the printed number what was rounded to it may lie: further where it is derived from others."""
    if not isinstance(entry.printed, int | float):
        raise ValueError(f"{entry.id} is no single number")
    return entry.printed - entry.leaves_open[0] if entry.leaves_open else half_unit(entry.printed, entry.unit)


def judge_difference(printed: float, rounding: float, measured: Pair | None) -> Verdict:
    """A printed gain against the interval of the measured one; without an interval nothing is settled."""
    if measured is None:
        return "inconclusive"
    low, high = measured
    if high < printed - rounding:
        return "does not hold"
    return "holds" if low >= printed - rounding else "inconclusive"


def judge_gain(
    printed: float, rounding: float, difference: float | None, interval: Pair | None, unpaired: int
) -> Verdict:
    """The same for a comparison: where cells were lost, their survivors settle nothing, and less so without any."""
    if difference is None:
        return "inconclusive" if unpaired else UNTESTED
    return "inconclusive" if unpaired else judge_difference(printed, rounding, interval)


def judge_level(printed: float, margin: float, measured: Pair | None) -> Verdict:
    """A printed level: *holds* where the interval lies within `margin` of it, *does not hold* where it lies outside."""
    if measured is None:
        return "inconclusive"
    low, high = measured
    if high < printed - margin or low > printed + margin:
        return "does not hold"
    return "holds" if printed - margin <= low and high <= printed + margin else "inconclusive"


def judge_figures(printed: float, rounding: float, computed: float, reachable: Pair) -> Verdict:
    """A printed result against what the printed figures give: `computed` from them as they stand, `reachable` from
    all that rounds to them.

    *holds* where `computed` rounds to the printed result, *does not hold* where nothing reachable does, and
    *inconclusive* where only the rounding of the figures could explain it.
    """
    slack = 1e-9 * max(1.0, abs(printed))  # decimals are no binary fractions
    if abs(computed - printed) <= rounding + slack:
        return "holds"
    missed = reachable[1] < printed - rounding - slack or reachable[0] > printed + rounding + slack
    return "does not hold" if missed else "inconclusive"


def interval_of_mean(values: list[float]) -> Pair | None:
    """Student's 95 % interval of the mean of independent values; None for fewer than two."""
    if len(values) < 2:
        return None
    mean = sum(values) / len(values)
    variance = sum((value - mean) ** 2 for value in values) / (len(values) - 1)
    half = STUDENT.get(len(values) - 1, STUDENT[9]) * (variance / len(values)) ** 0.5
    return (mean - half, mean + half)
