"""Tables that a record brings with it → tables as plain data."""

from collections.abc import Callable

from harness.chart_record import Table
from reports.grid import EMPTY, Column, Entry, Grid


def tables_grids(tables: list[Table], item: int, write: Callable[[float], str]) -> list[Grid]:
    """Those of one question or chapter; a column of nothing but numbers is set to the right, as `write` writes them."""
    return [_grid(one, write) for one in tables if one.item == item and one.rows and one.columns]


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
