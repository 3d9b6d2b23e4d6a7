"""A table as plain data, which `page.html` lays out and tests compare with literals."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import NoneType

from harness.records.study import Table
from reports.data.selection import Selection


@dataclass(frozen=True)
class Entry:
    """One cell of a table: its text, a smaller second line, and a tone that the page gives a look.

    Invisible fields take no part in comparisons: two entries are equal if a reader sees the same.
    """

    text: str
    small: str = ""
    tone: str = ""
    """The tone: `above gain`, `below loss`, … of a sign, `open`, `failed`, `muted`, or nothing."""
    value: float | str | None = field(default=None, compare=False)
    """The value it is sorted by and saved as: a number before it was rounded, the scene if its name is not repeated;
    None for a text, which is sorted as one.
    """
    parts: Mapping[str, float | str | None] = field(default_factory=dict, compare=False)
    """The additional values in a file, by name: the ends of an interval, a standard deviation, a unit."""
    runs: Selection | None = field(default=None, compare=False)
    link: str = field(default="", compare=False)
    """The id of a place in the page that the text leads to."""


@dataclass(frozen=True)
class Column:
    label: str
    method: str = ""
    """The method that a column belongs to: the page shows its colour."""
    small: str = ""
    numeric: bool = True


@dataclass(frozen=True)
class Grid:
    """Rows of entries under columns; `totals` stand apart below, `note` explains what the numbers are."""

    caption: str
    columns: list[Column]
    rows: list[list[Entry]]
    totals: list[list[Entry]] = field(default_factory=list)
    note: str = ""
    filtered: bool = True
    """Whether rows of scenes and methods that a reader hides are hidden with them."""


EMPTY = Entry("–", tone="muted")


def without_empty_columns(grid: Grid, always: int = 0) -> Grid:
    """Leave out the columns, from the place `always` on, in which nothing stands."""
    kept = [
        place for place in range(len(grid.columns)) if place < always or any(row[place] != EMPTY for row in grid.rows)
    ]
    rows = [[row[place] for place in kept] for row in grid.rows]
    return replace(grid, columns=[grid.columns[place] for place in kept], rows=rows)


def table_grid(table: Table, write: Callable[[float], str]) -> Grid:
    """Return a study's table; a column of nothing but numbers is set to the right, as `write` writes them."""
    kinds = [{type(row[place]) for row in table.rows} - {NoneType} for place in range(len(table.columns))]
    columns = [
        Column(label, numeric=place > 0 and bool(of_column) and str not in of_column)
        for place, (label, of_column) in enumerate(zip(table.columns, kinds, strict=True))
    ]

    def entry(value: str | float | None) -> Entry:
        if value is None:
            return EMPTY
        if isinstance(value, str):
            return Entry(value.replace(" ± ", "\u00a0±\u00a0"))
        return Entry(write(value), value=float(value))

    return Grid(table.title, columns, [list(map(entry, row)) for row in table.rows])
