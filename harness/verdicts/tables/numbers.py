"""Cells of printed tables: their emphasis and units are removed, numbers and missing results recognised."""

import math
import re
from collections.abc import Sequence
from typing import Any

LARGEST = 1e12
"""The limit of scores, whose squares are finite."""
MISSING = (
    "", "-", "--", "---", "–", "—", "−", "n/a", "n.a.", "na", "none", "null", "x", "✗", "✘", "×", "?", "tba",
    "tbd", "n.d.", "#n/a",
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
BRACED = r"\{(?:[^{}]|\{[^{}]*\})*\}"
ARGUMENT = rf"(?:\[[^\]]*\]|{BRACED})"
DIAGONAL = re.compile(r"\\(?:diagbox|(?:back)?slashbox)(?:\[[^\]]*\])?\{([^{}]*)\}\{([^{}]*)\}")
DROPPED = re.compile(
    rf"\\(?:cite[a-z]*|textsuperscript|textsubscript|footnote(?:mark|text)?|tablefootnote|label|ref|rule|"
    rf"cdashline|addlinespace|Xhline|cmidrule|cline|specialrule|hhline|arrayrulecolor|noalign)(?![a-zA-Z])\*?(?:\([^)]*\))?{ARGUMENT}*"
)
"""LaTeX commands that are not part of a cell, with their arguments."""
FIRST_DROPPED = re.compile(
    r"\\(?:cellcolor|rowcolor|color|textcolor|colorbox|rotatebox|scalebox|raisebox|SetCell|Block|[hv]?phantom|[hv]space)"
    rf"\*?(?:\[[^\]]*\])*{BRACED}(?:\[[^\]]*\])*|\\(?:[hv]skip|kern)\s*-?[\d.]+\s*[a-z]{{2}}"
)
"""LaTeX commands whose first argument is not part of the cell, nor the first two of `FRAME` and `MULTIROW`."""
MULTIROW = re.compile(r"\\multirow\*?(?:\[[^\]]*\])*\{[^{}]*\}(?:\[[^\]]*\])*\{[^{}]*\}")
SPREAD_COMMAND = re.compile(r"\\[a-zA-Z]*(?:std|err|dev|pm)[a-zA-Z]*\s*\{([^{}]*)\}")
FRAME = re.compile(r"\\fcolorbox\{[^{}]*\}\{[^{}]*\}")
SMALLER = re.compile(r"(?<=\d)\s*\{\s*\\(?:tiny|scriptsize|footnotesize|small)\s*((?:[^{}±]|\{[^{}±]*\})*)\}")
"""What stands in small print behind a number, such as a gain or a spread without its sign."""
TWO = re.compile(r"\\[a-zA-Z]+\{([^{}]*)\}\{([^{}]*)\}")
WRAPPER = re.compile(r"\\[a-zA-Z]+\*?(?:\[[^\]]*\])*\{([^{}]*)\}")
GAIN = r"\{[\s({]*[+\-−↑↓]"
RAISED = re.compile(
    rf"(?<=\d)(?:\^(?:{BRACED}|\\[a-zA-Z]+|[^\s{{}}])|_(?!\{{\s*±){BRACED}|_\d(?=\$))|(?<=\d\}})_(?={GAIN}){BRACED}|"
    r"\^\{?(?:\\(?:d?dagger|ast|star)|\*)\}?|\^(?=[\w{])"
)
"""Footnote marks, and what is raised or lowered behind a number but a spread; of other raised text only the sign."""
MARKS = " *†‡§¶🥇🥈🥉¹²³⁴⁵⁶⁷⁸⁹⁰"
NUMBER = re.compile(
    r"([+\-−]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+\-]?\d+)?)\s*(?:dB|db|%|s)?\s*"
    r"(?:(?:±|\+/-|\+-).*|\(.*\)|\[.*\]|[↑↓▲▼].*)?"
)
THOUSANDS = re.compile(r"[1-9]\d{0,2}(?:,\d{3})+")


def plain(text: str) -> str:
    """Return a cell without the markup of LaTeX, Markdown and HTML. Of a cell that is only an unknown command, the name
    of that command.
    """
    given = text
    text = re.sub(r"\s*(?:\\times|\\cdot|×)\s*10\s*\^\s*\{?\s*([-−+]?\d+)\s*\}?", r"e\1", text)
    text = re.sub(r"\[\^[^\[\]]*\]", "", text)  # a footnote of Markdown
    text = re.sub(r"(?<=\d)<(su[bp])>.*?</\1>|(?<=\d\}|.\d)\$_\{?\d\}?\$", "", text)
    for sign, character in SIGNS.items():
        text = re.sub(re.escape(sign) + r"(?![a-zA-Z])" * sign[-1].isalpha(), character, text)
    text = FRAME.sub("", MULTIROW.sub("", DROPPED.sub("", DIAGONAL.sub(r"\1 / \2", text))))
    text = FIRST_DROPPED.sub("", text)
    text = RAISED.sub("", re.sub(rf"\$(?=\^|_{GAIN})", "", text).replace("^↑", "↑").replace("^↓", "↓"))
    text = SMALLER.sub(r" (\1)", SPREAD_COMMAND.sub(r" ± \1", text))
    text = re.sub(r"\\\\\*?(?:\[[^\]]*\])?|<br\s*/?>", " ", text)  # a line break within a cell
    while (inner := WRAPPER.sub(r"\1", TWO.sub(_of_two, text))) != text:
        text = inner
    text = re.sub(r"\\[a-zA-Z]+\*?|[${}]|</?[a-zA-Z]+(?:\s[^<>]*)?/?>", "", text)
    text = re.sub(r"\\[,;:!>]", " ", text).replace("\\", "")
    text = re.sub(r"_\s*(?=±)", " ", text)
    text = re.sub(r"!?\[([^\[\]]*)\]\([^()]*\)", r"\1", text)  # a link of Markdown
    for _ in range(2):
        text = re.sub(r"(\*{1,3}|_{1,3}|`)(?=\S)(.+?)(?<=\S)\1(?!\w)", r"\2", text) if text[:1] in "*_`" else text
    text = re.sub(r"\s+", " ", text).strip(" 🥇🥈🥉⭐🏆")
    if not text and (command := re.fullmatch(r"\s*\\([a-zA-Z]{2,})(?:\{\})?\s*", given)):
        return command[1]
    # marks belong to names, such as `Ours†`, and not to numbers
    return stripped if number(stripped := text.strip(MARKS)) is not None or not stripped else text


def _of_two(match: re.Match[str]) -> str:
    """Return of an unknown command with two arguments the first if it is a number, as in `\\score{27.1}{2}`."""
    return match[1] if number(match[1]) is not None else f"{match[1]} {match[2]}"


def is_missing(value: object) -> bool:
    return value is None or (isinstance(value, str) and _word(value) in MISSING) or is_failed(value)


def is_failed(value: object) -> bool:
    return isinstance(value, str) and _word(value) in FAILED


def _word(value: str) -> str:
    text = value.strip().lower().strip(MARKS)
    return text[1:-1].strip() if text[:1] + text[-1:] in ("()", "[]") else text


def number(value: Any) -> float | None:
    """Return a value as a number; None if it is not one, not finite or larger than `LARGEST`."""
    if isinstance(value, bool) or (isinstance(value, str) and "_" in value):  # which Python ignores within a number
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
