"""Grids without what is neither a header nor a result: empty rows and columns, units, titles; one score per cell."""

import re
from dataclasses import replace

from harness.verdicts.tables.grids import Grid
from harness.verdicts.tables.headers import UNITS, bare, beside_metric, metric_of, metrics_named, role_of
from harness.verdicts.tables.numbers import number


def tidied(grid: Grid) -> Grid:
    """Return a grid without empty rows and columns, units, repeated headers, and rows that are titles of groups; a cell
    with scores of several metrics becomes several cells, and titles that name metrics a column of these.
    """
    width = range(len(grid.rows[0]))
    columns = [k for k in width if any(row[k].strip() for row in grid.rows)]
    rows, lines, around, titles = list[list[str]](), list[int](), list(grid.around), list[str]()
    metric, metrics = "", list[str]()
    for place, (row, line) in enumerate(zip(grid.rows, grid.lines, strict=True)):
        cells = [row[k].strip() for k in columns]
        filled = [cell for cell in cells if cell]
        title = filled[0] if len({*filled}) == 1 else ""
        is_metric = bool(metric_of(bare(title))) and not beside_metric(bare(title))
        if not filled or (place and all(_is_unit(cell) for cell in filled)) or cells in rows[:1]:
            continue
        is_title = len(filled) in (1, len(cells)) if cells[0] else bool(rows) and is_metric and filled == cells[1:]
        if title and is_title and len(columns) > 1 and not role_of(title) and number(title) is None:
            metric = title if is_metric else metric
            if rows:
                titles.append(title)
            else:
                around.insert(0, title)
            continue
        rows.append(cells)
        lines.append(line)
        metrics.append(metric)
    if not rows:
        return Grid([[""]], [1], tuple(around))
    first = next((k for k, row in enumerate(rows) if k and any(number(cell) is not None for cell in row[1:])), 1)
    if metric and all(metrics[first:]):
        around.insert(0, metric)
        titles = [title for title in titles if title not in metrics]
        if len({*metrics[first:]}) > 1:
            of_rows = ["metric"] * first + metrics[first:]
            rows = [[row[0], name, *row[1:]] for row, name in zip(rows, of_rows, strict=True)]
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
