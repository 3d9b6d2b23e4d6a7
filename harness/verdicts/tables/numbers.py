"""Cells of printed tables: their emphasis and units are removed, numbers and missing results recognised."""

import math
import re
from collections.abc import Sequence
from typing import Any

LARGEST = 1e12
"""The limit of scores, whose squares are finite."""
MISSING = ("", "-", "--", "---", "–", "—", "n/a", "n.a.", "na", "none", "null", "oom", "x", "✗", "×", "?", "tba", "tbd")
"""What stands for a result that does not exist. NaN does not: it may be the result of a run that diverged."""
ARROWS = "↑↓⬆⬇"
SIGNS = {
    "\\uparrow": "↑",
    "\\downarrow": "↓",
    "\\pm": "±",
    "\\times": "×",
    "\\%": "%",
    "\\_": "_",
    "\\&": "&",
    "~": " ",
}
COMMANDS = re.compile(r"\\(?:cellcolor|rowcolor|color|textcolor|multirow|hspace|vspace)\*?(?:\[[^\]]*\])?\{[^{}]*\}")
"""LaTeX commands whose first argument is not part of the cell."""
WRAPPER = re.compile(r"\\[a-zA-Z]+\*?(?:\[[^\]]*\])?\{([^{}]*)\}")
NUMBER = re.compile(
    r"([+\-−]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+\-]?\d+)?)\s*(?:dB|%|s)?\s*(?:(?:±|\+/-|\+-).*|\(.*\))?"
)


def plain(text: str) -> str:
    """Return a cell without the markup of LaTeX, Markdown and HTML."""
    text = COMMANDS.sub("", text)
    for sign, character in SIGNS.items():
        text = text.replace(sign, character)
    while (inner := WRAPPER.sub(r"\1", text)) != text:
        text = inner
    text = re.sub(r"\\[a-zA-Z]+\*?|[${}]|</?[a-z]+>", "", text).replace("\\,", " ").replace("\\", "")
    text = re.sub(r"(\*{1,3}|_{2,3}|`)(?=\S)(.+?)(?<=\S)\1", r"\2", text)
    return re.sub(r"\s+", " ", text).strip(" *†‡§🥇🥈🥉")


def is_missing(value: object) -> bool:
    return value is None or (isinstance(value, str) and value.strip().lower() in MISSING)


def number(value: Any) -> float | None:
    """Return a value as a number; None if it is not one, not finite or larger than `LARGEST`."""
    if isinstance(value, bool):
        return None
    if isinstance(value, str) and (match := NUMBER.fullmatch(value.strip())):
        value = match[1].replace(",", ".").replace("−", "-")
    try:
        as_float = float(value)
    except (TypeError, ValueError, OverflowError):
        return None
    return as_float if abs(as_float) <= LARGEST else None


def has_spread(value: object) -> bool:
    """Return whether a cell prints a spread behind its number, as in `31.2 ± 0.3`."""
    return isinstance(value, str) and number(value) is not None and bool(re.search(r"±|\+/-|\+-|\(", value))


def is_column_of_numbers(values: Sequence[object]) -> bool:
    first = next((value for value in values if not is_missing(value)), None)
    return first is not None and number(first) is not None


def decimals(values: Sequence[float]) -> int:
    """Return the number of decimals, at most 6, with which all finite values are printed."""
    known = [value for value in values if math.isfinite(value)]
    return next((digits for digits in range(6) if all(abs(round(v, digits) - v) < 1e-9 for v in known)), 6)
