"""Lines and tables that a measurement leaves behind beside its figures, for whoever draws them.

This module imports the standard library alone, as reports read it.
"""

from dataclasses import dataclass

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
