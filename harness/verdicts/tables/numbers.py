"""Cells of printed tables: their emphasis and units are removed, numbers and missing results recognised."""

import math
import re
from collections.abc import Sequence
from typing import Any

LARGEST = 1e12
"""The limit of scores, whose squares are finite."""
MISSING = (
    "", "-", "--", "---", "–", "—", "−", "n/a", "n.a.", "na", "none", "null", "x", "✗", "✘", "×", "?", "tba", "tbd",
    "/", ".", "...", "…", "n/r",
)  # fmt: skip
"""What stands for a result that does not exist. NaN does not: it may be the result of a run that diverged."""
FAILED = ("oom", "oot", "dnf", "fail", "failed", "diverged", "timeout", "crash", "crashed")
"""What stands for a run without a result: missing as well, and counted in a note."""
ARROWS = "↑↓⬆⬇▲▼"
SIGNS = {
    "\\uparrow": "↑",
    "\\downarrow": "↓",
    "\\pm": "±",
    "\\times": "×",
    "\\%": "%",
    "\\_": "_",
    "\\&": "&",
    "\\#": "#",
    "\\Delta": "Δ",
    "~": " ",
    "\\ding{55}": "✗",
    "\\ding{51}": "✓",
    "\\xmark": "✗",
}
ARGUMENT = r"(?:\[[^\]]*\]|\{[^{}]*\})"
DROPPED = re.compile(
    rf"\\(?:cite[a-z]*|textsuperscript|footnote(?:mark|text)?|tablefootnote|label|ref|rule|hspace|vspace|cdashline|"
    rf"addlinespace|Xhline|cmidrule|cline|specialrule|hhline|arrayrulecolor|noalign)\*?(?:\([^)]*\))?{ARGUMENT}*"
)
"""LaTeX commands that are not part of a cell, with their arguments."""
FIRST_DROPPED = re.compile(
    r"\\(?:cellcolor|rowcolor|color|textcolor|colorbox|multirow|rotatebox|scalebox|raisebox)\*?(?:\[[^\]]*\])*\{[^{}]*\}"
)
"""LaTeX commands whose first argument is not part of the cell, nor the second of `FRAMED` and `MULTIROW`."""
MULTIROW = re.compile(r"\\multirow\*?(?:\[[^\]]*\])*\{[^{}]*\}(?:\[[^\]]*\])*\{[^{}]*\}")
SPREAD_COMMAND = re.compile(r"\\[a-zA-Z]*(?:std|err|dev|pm)[a-zA-Z]*\s*\{([^{}]*)\}")
WRAPPER = re.compile(r"\\[a-zA-Z]+\*?(?:\[[^\]]*\])?\{([^{}]*)\}")
RAISED = re.compile(r"(?<=\d)\^(?:\{[^{}]*\}|\\[a-zA-Z]+|[^\s{}])|\^\{?(?:\\(?:d?dagger|ast|star)|\*)\}?|\^(?=[\w{])")
"""Footnote marks, and all that is raised behind a number; of other raised text only the sign."""
MARKS = " *†‡§¶🥇🥈🥉¹²³⁴⁵⁶⁷⁸⁹⁰"
NUMBER = re.compile(
    r"([+\-−]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+\-]?\d+)?)\s*(?:dB|db|%|s)?\s*"
    r"(?:(?:±|\+/-|\+-).*|\(.*\)|\[.*\]|[↑↓▲▼].*)?"
)
THOUSANDS = re.compile(r"[1-9]\d{0,2}(?:,\d{3})+")


def plain(text: str) -> str:
    """Return a cell without the markup of LaTeX, Markdown and HTML."""
    for sign, character in SIGNS.items():
        text = text.replace(sign, character)
    text = FIRST_DROPPED.sub("", MULTIROW.sub("", DROPPED.sub("", text)))
    text = RAISED.sub("", re.sub(r"\$\^", "^", text).replace("^↑", "↑").replace("^↓", "↓"))
    text = SPREAD_COMMAND.sub(r" ± \1", text)
    text = re.sub(r"\\\\(?:\[[^\]]*\])?", " ", text)  # a line break within a cell
    while (inner := WRAPPER.sub(r"\1", text)) != text:
        text = inner
    text = re.sub(r"\\[a-zA-Z]+\*?|[${}]|</?[a-zA-Z]+(?:\s[^<>]*)?/?>", "", text).replace("\\,", " ").replace("\\", "")
    text = re.sub(r"_\s*(?=±)", " ", text)
    text = re.sub(r"!?\[([^\[\]]*)\]\([^()]*\)", r"\1", text)  # a link of Markdown
    text = re.sub(r"(\*{1,3}|_{2,3}|`)(?=\S)(.+?)(?<=\S)\1", r"\2", text)
    return re.sub(r"\s+", " ", text).strip(MARKS)


def is_missing(value: object) -> bool:
    return value is None or (isinstance(value, str) and _word(value) in MISSING) or is_failed(value)


def is_failed(value: object) -> bool:
    return isinstance(value, str) and _word(value) in FAILED


def _word(value: str) -> str:
    text = value.strip().lower().strip(MARKS)
    return text[1:-1].strip() if text[:1] + text[-1:] in ("()", "[]") else text


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
    return isinstance(value, str) and number(value) is not None and bool(re.search(r"±|\+/-|\+-|\(|\[", value))


def is_column_of_numbers(values: Sequence[object]) -> bool:
    first = next((value for value in values if not is_missing(value)), None)
    return first is not None and number(first) is not None


def decimals(values: Sequence[float]) -> int:
    """Return the number of decimals, at most 6, with which all finite values are printed."""
    known = [value for value in values if math.isfinite(value)]
    return next((digits for digits in range(6) if all(abs(round(v, digits) - v) < 1e-9 for v in known)), 6)
