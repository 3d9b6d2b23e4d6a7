"""A table as plain data: what `page.html` lays out and what tests compare with literals."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Entry:
    """One cell of a table: its text, a smaller second line, and a tone that the page gives a look."""

    text: str
    small: str = ""
    tone: str = ""
    """`better`, `worse`, `equivalent`, `inconclusive`, `failed`, `muted`, or nothing."""


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


EMPTY = Entry("–", tone="muted")
