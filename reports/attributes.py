"""What the page's script reads off a table: values to sort by, numbers for files, the runs behind a cell."""

import json
import math
import re
from typing import Any

from markupsafe import Markup, escape

from reports.grid import Entry
from reports.selection import Selection
from reports.wording import MINUS, NARROW, RAISED

LEVELLED = {level: plain for plain, level in RAISED.items()}
FIGURE = re.compile(
    rf"[+~≈]?(?P<sign>[{MINUS}-]?)(?:10(?P<bare>[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)"
    rf"|(?P<digits>\d[\d{NARROW}]*(?:\.\d+)?)(?:·10(?P<power>[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?)(?P<rest>.*)",
    re.DOTALL,
)
UNITS = {
    "ns": 1e-9, "µs": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0,
    "B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12, "k": 1e3, "M": 1e6, "G": 1e9,
}  # fmt: skip
"""Units that change within a column."""


def value_of(text: str) -> float | None:
    """The number at the beginning of a text of ours, in seconds or bytes where it is a time or a size; None where
    there is none, or it only counts what was lost, as in `2 of 3 diverged`, or it is the end of a range.
    """
    found = FIGURE.fullmatch(text.strip())
    if found is None:
        return None
    power = found["power"] or found["bare"] or ""
    digits = (found["digits"] or "1").replace(NARROW, "")
    value = float(f"{digits}e{power.translate(LEVELLED) or '0'}")
    rest = found["rest"].replace(NARROW, " ").replace("\u00a0", " ")
    if re.match(rf"\s+of\s+(\d|the)|\s+to\s+[+{MINUS}]?\d|\s*[–/x]\s*\d|\d|[.,]", rest) or re.match(r"\w{4,}", rest):
        return None
    return (-value if found["sign"] else value) * _scale(rest) + _rest_of_clock(rest)


def _scale(rest: str) -> float:
    words = rest.split()
    return UNITS.get(words[0], 1.0) if words else 1.0


def _rest_of_clock(rest: str) -> float:
    """3 min *20 s*, 2 h *05 min*."""
    found = re.match(r" (min|h) (\d\d) (s|min)\b", rest)
    return float(found[2]) * UNITS[found[3]] if found else 0.0


def of_entry(one: Entry, numeric: bool) -> Markup:
    """Attributes of a table cell."""
    found: dict[str, str] = {}
    value = value_of(one.text) if one.value is None and numeric else one.value
    if isinstance(value, str):
        found["said"] = value
    elif value is not None and math.isfinite(value):
        found["value"] = f"{value:.7g}"
    parts = {name: known for name, part in one.parts.items() if (known := _part(part)) is not None}
    if parts:
        found["parts"] = as_json(parts)
    return _written(found) + of_runs(one.runs)


def _part(part: float | str | None) -> float | str | None:
    if part is None or isinstance(part, str):
        return part
    return float(f"{part:.7g}") if math.isfinite(part) else None


def of_runs(runs: Selection | None) -> Markup:
    """The attribute of a cell that shows the runs behind it; none where there are none."""
    return _written({"runs": as_json(runs.data())} if runs is not None and runs.data() else {})


def of_row(row: list[Entry]) -> Markup:
    """The scene and the method that all of a row belong to: what a filter goes by."""
    found = {}
    for name in ("scene", "method"):
        values = {getattr(one.runs, name) for one in row if one.runs is not None}
        if len(values) == 1 and (value := values.pop()):
            found[name] = value
    return _written(found)


def as_json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _written(found: dict[str, str]) -> Markup:
    return Markup("").join(Markup(' data-{}="{}"').format(name, escape(value)) for name, value in found.items())
