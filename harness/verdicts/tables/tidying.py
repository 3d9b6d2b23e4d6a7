"""Grids without what is neither a header nor a result: empty rows and columns, units, titles; one score per cell."""

import re
from dataclasses import replace

from harness.verdicts.tables.grids import Grid
from harness.verdicts.tables.headers import UNITS, metrics_named, role_of
from harness.verdicts.tables.numbers import number


def tidied(grid: Grid) -> Grid:
    """Return a grid without empty rows and columns, units, and rows that are titles of groups; a cell with scores of
    several metrics becomes several cells.
    """
    width = range(len(grid.rows[0]))
    columns = [k for k in width if any(row[k].strip() for row in grid.rows)]
    rows, lines, around, titles = list[list[str]](), list[int](), list(grid.around), list[str]()
    for place, (row, line) in enumerate(zip(grid.rows, grid.lines, strict=True)):
        cells = [row[k].strip() for k in columns]
        filled = [cell for cell in cells if cell]
        is_title = len({*filled}) == 1 and bool(cells[0]) and (len(filled) in (1, len(cells)))
        if not filled or (place and all(_is_unit(cell) for cell in filled)):
            continue
        if is_title and len(columns) > 1 and not role_of(cells[0]) and number(cells[0]) is None:
            if rows:
                titles.append(cells[0])
            else:
                around.insert(0, cells[0])
            continue
        rows.append(cells)
        lines.append(line)
    if not rows:
        return Grid([[""]], [1], tuple(around))
    return _one_score_per_cell(Grid(rows, lines, tuple(around), tuple(titles)))


def _is_unit(cell: str) -> bool:
    return cell.strip("()[] ↑↓").lower() in UNITS or not cell.strip("↑↓ ")


def _one_score_per_cell(grid: Grid) -> Grid:
    """Divide cells such as `27.31 / 0.81 / 0.2`, if the headers or the text name as many metrics in that order."""

    def parts(cell: str) -> list[str]:
        divided = re.split(r"\s*[/|;]\s*", cell)
        return divided if len(divided) > 1 and all(number(part) is not None for part in divided) else []

    many = {len(parts(cell)) for row in grid.rows[1:] for cell in row if parts(cell)}
    if len(many) != 1:
        return grid
    (count,) = many
    named = (metrics_named(text) for text in (*grid.rows[0], *grid.around))
    metrics = next((found for found in named if len(found) == count), None)
    if metrics is None:
        return grid
    divided = [any(parts(row[k]) for row in grid.rows[1:]) for k in range(len(grid.rows[0]))]

    def spread_out(row: list[str], of_header: bool) -> list[str]:
        cells = []
        for cell, several in zip(row, divided, strict=True):
            cells += ([cell] * count if of_header else parts(cell) or [cell] * count) if several else [cell]
        return cells

    below = [name for several in divided for name in (metrics if several else [""])]
    rows = [spread_out(grid.rows[0], True), below, *(spread_out(row, False) for row in grid.rows[1:])]
    return replace(grid, rows=rows, lines=[grid.lines[0], grid.lines[0], *grid.lines[1:]])
