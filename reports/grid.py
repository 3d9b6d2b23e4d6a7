"""A table as plain data: what `page.html` lays out and what tests compare with literals."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from reports.selection import Selection


@dataclass(frozen=True)
class Entry:
    """One cell of a table: its text, a smaller second line, and a tone that the page gives a look.

    What is not seen takes no part in comparisons: two entries are equal where a reader sees the same.
    """

    text: str
    small: str = ""
    tone: str = ""
    """`better`, `worse`, `equivalent`, `inconclusive`, `failed`, `muted`, or nothing."""
    value: float | str | None = field(default=None, compare=False)
    """What it is sorted by and saved as, where that is not what its text says: a number before it was rounded, the
    scene where its name is not repeated."""
    parts: Mapping[str, float | str | None] = field(default_factory=dict, compare=False)
    """What a file says of it besides, by name: the ends of an interval, a standard deviation, a unit."""
    runs: Selection | None = field(default=None, compare=False)
    """The runs behind it."""


@dataclass(frozen=True)
class Column:
    label: str
    method: str = ""
    """Where the column belongs to a method: the page shows its colour."""
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
    """Whether rows of scenes and methods that a reader takes out of sight go with them."""


EMPTY = Entry("–", tone="muted")
