"""A table as plain data, which `parts.html` lays out and tests compare with literals."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import NoneType

from harness.records.study import Table
from reports.data.selection import Selection
from reports.data.wording import number


@dataclass(frozen=True)
class Entry:
    """One cell of a table: its text, a smaller second line, and a tone that the style gives a colour.

    Two entries are equal if a reader sees the same: comparisons ignore the invisible fields.
    """

    text: str
    small: str = ""
    tone: str = ""
    """`above gain`, `below loss`, … for a sign, `open`, `failed`, `muted`, or nothing."""
    value: float | str | None = field(default=None, compare=False)
    """For sorting and saving: the unrounded number, or a scene whose name is not repeated; None if it is the text."""
    parts: Mapping[str, float | str | None] = field(default_factory=dict, compare=False)
    """Additional values for saving, by name: the ends of an interval, a standard deviation, a unit."""
    runs: Selection | None = field(default=None, compare=False)
    link: str = field(default="", compare=False)
    """The id of an element in the page that the text links to."""


@dataclass(frozen=True)
class Column:
    label: str
    method: str = ""
    """The method that the column belongs to, whose colour the page shows."""
    small: str = ""
    numeric: bool = True


@dataclass(frozen=True)
class Grid:
    """Rows of entries under columns; `totals` are set apart below, `note` explains the numbers."""

    caption: str
    columns: list[Column]
    rows: list[list[Entry]]
    totals: list[list[Entry]] = field(default_factory=list)
    note: str = ""
    filtered: bool = True
    """Whether the reader's filter of scenes and methods hides rows of it."""


EMPTY = Entry("–", tone="muted")
Q_COLUMN = Column("q", small="false discovery rate")


def value_entry(value: float | None, write: Callable[[float], str]) -> Entry:
    """Return a number as `write` formats it; empty if there is none."""
    return EMPTY if value is None else Entry(write(value), value=value)


def q_entry(q: float | None) -> Entry:
    return value_entry(q, lambda q: number(q, 3))


def without_empty_columns(grid: Grid, always: int = 0) -> Grid:
    """Leave out empty columns, except among the first `always` columns."""
    kept = [
        place for place in range(len(grid.columns)) if place < always or any(row[place] != EMPTY for row in grid.rows)
    ]
    rows = [[row[place] for place in kept] for row in grid.rows]
    return replace(grid, columns=[grid.columns[place] for place in kept], rows=rows)


def table_grid(table: Table, write: Callable[[float], str]) -> Grid:
    """Return a study's table; columns of numbers are right-aligned, and `write` formats them."""
    kinds = [{type(row[place]) for row in table.rows} - {NoneType} for place in range(len(table.columns))]
    columns = [
        Column(label, numeric=place > 0 and bool(of_column) and str not in of_column)
        for place, (label, of_column) in enumerate(zip(table.columns, kinds, strict=True))
    ]

    def entry(value: str | float | None) -> Entry:
        return Entry(value.replace(" ± ", "\u00a0±\u00a0")) if isinstance(value, str) else value_entry(value, write)

    return Grid(table.title, columns, [list(map(entry, row)) for row in table.rows])
