"""Lines and tables that a measurement leaves behind beside its figures, for whoever draws them.

This module imports the standard library alone, as reports read it.
"""

import math
from dataclasses import dataclass
from typing import Any

Values = list[float] | list[float | None]
"""None where the figure was not finite: a gap in the line, which a chart marks."""


@dataclass(frozen=True)
class Series:
    """One line of a chart; lines with the same `panel` share their axes."""

    panel: str
    item: int
    """Number of the question or chapter that it belongs to."""
    name: str
    x_label: str
    y_label: str
    x: list[float]
    y: Values
    low: Values | None = None
    high: Values | None = None
    log_x: bool = True
    log_y: bool = True


@dataclass(frozen=True)
class Table:
    """Rows that are no single figure: where the remaining time goes, for instance."""

    id: str
    item: int
    title: str
    columns: list[str]
    rows: list[list[str | float | None]]


def with_gaps(record: dict[str, Any]) -> None:
    """Makes the `series` and `tables` of a record, as plain data, fit for JSON, in place: a point of a line that is not
    finite becomes a gap, a table's becomes words.
    """
    for line in record["series"]:
        for name in ("y", "low", "high"):
            line[name] = None if line[name] is None else [_finite_or_gap(value) for value in line[name]]
    for table in record["tables"]:
        table["rows"] = [[_said(value) for value in row] for row in table["rows"]]


def _finite_or_gap(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _said(value: str | float | None) -> str | float | None:
    return f"not finite ({value})" if isinstance(value, float) and not math.isfinite(value) else value
