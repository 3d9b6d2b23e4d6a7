"""A table as plain data, which `page.html` lays out and tests compare with literals."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

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
    """The tone: `better`, `worse`, `equivalent`, `inconclusive`, `failed`, `muted`, or nothing."""
    value: float | str | None = field(default=None, compare=False)
    """The value it is sorted by and saved as, if its text differs: a number before it was rounded, the scene if its
    name is not repeated.
    """
    parts: Mapping[str, float | str | None] = field(default_factory=dict, compare=False)
    """The additional values in a file, by name: the ends of an interval, a standard deviation, a unit."""
    runs: Selection | None = field(default=None, compare=False)
    """The runs behind it."""
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


def tables_grids(tables: list[Table], write: Callable[[float], str]) -> list[Grid]:
    """The tables that are not empty; a column of nothing but numbers is set to the right, as `write` writes them."""
    return [_grid(one, write) for one in tables if one.rows and one.columns]


def _grid(table: Table, write: Callable[[float], str]) -> Grid:
    numeric = [
        any(not isinstance(row[place], str) and row[place] is not None for row in table.rows)
        and not any(isinstance(row[place], str) for row in table.rows)
        for place in range(len(table.columns))
    ]
    columns = [
        Column(label, numeric=right and place > 0)
        for place, (label, right) in enumerate(zip(table.columns, numeric, strict=True))
    ]
    return Grid(table.title, columns, [[_entry(value, write) for value in row] for row in table.rows])


def _entry(value: str | float | None, write: Callable[[float], str]) -> Entry:
    if value is None:
        return EMPTY
    if isinstance(value, str):
        return Entry(value.replace(" ± ", "\u00a0±\u00a0"))
    return Entry(write(value), value=float(value))
