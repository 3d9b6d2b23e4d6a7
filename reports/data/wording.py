"""Numbers as text on the page: sensible precision, true minus signs, never NaN or Infinity."""

import math
from typing import Literal, get_args

from harness.records.verdict import Sign
from harness.records.verdict import Verdict as TwoWords

Verdict = Literal["reproduced", "not reproduced", "seen", "not seen at this scale", "inconclusive", "not tested"]
"""The verdict on a statement of the paper; a difference has a `harness.records.verdict.Verdict`."""
UNTESTED: Verdict = "not tested"
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
MARKS: dict[Sign, str] = {"above 0": "▲", "below 0": "▼", "open": "?"}


def tone_of_sign(sign: Sign, higher_is_better: bool = True) -> str:
    """Return the tone of a difference, which follows its sign: a gain or a loss by the direction of its metric."""
    if sign == "open":
        return "open"
    return f"{sign.removesuffix(' 0')} {'gain' if (sign == 'above 0') == higher_is_better else 'loss'}"


def mark_of(verdict: TwoWords) -> str:
    """Return ▲, ▼ or ? for the sign, and = behind it where the size is smaller than matters."""
    return MARKS[verdict.sign] + "=" * (verdict.size == "smaller than matters")


BUDGETS = {"steps": "equal steps", "seconds": "equal training time", "core_seconds": "equal core seconds"}
DISCOVERIES = (
    "q: the false discovery rate at which a row would just count among those of the table that differ (Benjamini and "
    "Hochberg)."
)
NOTHING = "–"
MINUS = "−"
NARROW = "\u202f"
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 2) -> str:
    """Format with fixed decimals and a true minus sign; a dash for a missing or non-finite number."""
    if value is None or not math.isfinite(value):
        return NOTHING
    text = f"{value:.{digits}f}"
    if float(text) == 0:
        text = text.removeprefix("-")
    return text.replace("-", MINUS)


def signed(value: float | None, digits: int = 2) -> str:
    """Format like `number`, with + before positive numbers."""
    text = number(value, digits)
    return text if text[0] in MINUS + NOTHING or float(text) == 0 else f"+{text}"


def interval(pair: tuple[float, float] | None, digits: int = 2) -> str:
    """Format `[+0.21, +0.63]`, or nothing."""
    return "" if pair is None else f"[{signed(pair[0], digits)}, {signed(pair[1], digits)}]"


def significant(value: float | None, digits: int = 3) -> str:
    """Format a number of unknown magnitude: three significant digits, thin spaces between thousands."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if value == 0:
        return "0"
    magnitude = math.floor(math.log10(abs(value)))
    if magnitude >= digits - 1:
        return count(round(value))
    if magnitude < -digits:
        return scientific(value, digits)
    return number(value, digits - 1 - magnitude)


def scientific(value: float, digits: int = 3) -> str:
    """Format `2.13·10⁻⁷`; a power of ten without its factor 1."""
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return _with_power(mantissa, exponent)


def _with_power(mantissa: str, exponent: str) -> str:
    power = f"10{str(int(exponent)).translate(RAISED)}"
    return power if float(mantissa) == 1 else f"{mantissa}·{power}".replace("-", MINUS)


def of_any_size(value: float | None, digits: int = 3) -> str:
    """Format like `significant`; a power of ten from a million on, as errors reach 1e30; integers without decimals."""
    if value is None or not math.isfinite(value) or abs(value) < 1:
        return significant(value, digits)
    if abs(value) >= 1e6:
        return scientific(value, digits)
    return count(round(value)) if float(value).is_integer() else significant(value, digits)


def bare(value: float) -> str:
    """Format a limit without superfluous digits: 0.05, 30, 2·10⁻⁶."""
    if float(value).is_integer() and abs(value) < 1e6:
        return count(int(value))
    if 1e-2 <= abs(value) < 1e3:
        return number(value, 3).rstrip("0").rstrip(".")
    mantissa, exponent = f"{value:.3e}".split("e")
    return _with_power(f"{float(mantissa):g}", exponent)


def after(unit: str) -> str:
    return unit if unit in ("", "×", "°") else f"{NARROW}{unit}"


def count(value: int) -> str:
    """Format an integer with thin spaces between groups of three: 493 056."""
    return f"{value:,}".replace(",", NARROW).replace("-", MINUS)


def duration(seconds: float | None) -> str:
    """Format seconds for a reader: 0.8 s, 42 s, 3 min 20 s, 2 h 05 min."""
    if seconds is None or not math.isfinite(seconds):
        return NOTHING
    if seconds < 10:
        return f"{number(seconds, 1)} s"
    whole = round(seconds)
    if whole < 120:
        return f"{whole} s"
    if whole < 7200:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def listed(words: list[str], conjunction: str = "and") -> str:
    """Join words as in a, b and c."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} {conjunction} {words[-1]}"


def counted(many: int, noun: str, plural: str | None = None) -> str:
    """Format 1 seed, 3 seeds."""
    return f"{count(many)} {noun if many == 1 else plural or noun + 's'}"
