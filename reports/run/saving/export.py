"""All figures and tables of a run in a zip: PDF, SVG and PNG; CSV in full precision and LaTeX; a citation."""

import csv
import io
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import pandas as pd

from reports.claims.claim_list import claims
from reports.claims.estimands import senses_grid
from reports.claims.psnr_table import differences_grids, scores_grid
from reports.claims.table import chapters
from reports.data.load import Records
from reports.data.scale import in_a_line
from reports.data.studies_load import NO_SHELVES, ShelfRecords
from reports.drawing.figure import STYLE, draw
from reports.drawing.traces import Panel
from reports.page.grid import Grid
from reports.run import metrics_table
from reports.run.curves import diagrams
from reports.run.density import further_grid, separation_grid
from reports.run.figures import FIGURES
from reports.run.run_page import TABLES
from reports.run.saving.citation import bibtex
from reports.run.time_to_target import at_risk_grid, savings_grid
from scenes.files.atomic import write_atomically

FORMATS = ("pdf", "svg", "png")
DPI = 200
LONGEST_NAME = 80
EARLIEST = (1980, 1, 1, 0, 0, 0)
"""The earliest date in a zip, for every file: the same run gives the same bytes (except random ids in SVG)."""


def figures(records: Records) -> Iterator[tuple[str, Panel]]:
    drawn = [(figure.name, figure.panels(records)) for figure in FIGURES]
    drawn += [(diagram.name, diagram.panels) for diagram in diagrams(records)]
    yield from ((f"{name}-{panel.title}", panel) for name, panels in drawn for panel in panels)


def tables(records: Records, shelves: ShelfRecords) -> Iterator[Grid]:
    grids: list[Grid | None] = [scores_grid(records), senses_grid(records), *differences_grids(records)]
    grids += [further_grid(records), metrics_table.costs_grid(records), separation_grid(records)]
    if (targets := records.targets) is not None:
        grids += [savings_grid(targets, ["all"]), savings_grid(targets, records.scenes), at_risk_grid(targets)]
    grids += [metrics_table.metrics_grid(records), *(grid(records) for _, grid in TABLES.values())]
    grids += [grid for _, grid in chapters(claims(records, shelves), in_a_line(records))]
    grids.append(metrics_table.comparisons_grid(records))
    yield from (grid for grid in grids if grid is not None and grid.rows)


def as_csv(grid: Grid) -> str:
    """Return a table with its exact numbers and, in further columns, the parts of each entry."""
    rows = []
    for row in [*grid.rows, *grid.totals]:
        cells: dict[str, float | str | None] = {}
        for title, entry in zip(_titles(grid), row, strict=True):
            cells[title] = entry.text if entry.value is None else entry.value
            cells |= {f"{title}, {name}": part for name, part in entry.parts.items()}
        # colour-science makes NumPy print its numbers with only twelve digits
        rows.append({name: float(cell) if isinstance(cell, float) else cell for name, cell in cells.items()})
    text = io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(name for row in rows for name in row)))
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def as_latex(grid: Grid) -> str:
    """Return a table with the texts of the page, for booktabs."""
    rows = [[" ".join(f"{entry.text} {entry.small}".split()) for entry in row] for row in [*grid.rows, *grid.totals]]
    frame = pd.DataFrame(rows, columns=_titles(grid))
    return str(frame.to_latex(index=False, escape=True, caption=grid.caption))


def _titles(grid: Grid) -> list[str]:
    return [" ".join(filter(None, (column.label, column.small))) for column in grid.columns]


def write_export(records: Records, path: Path, shelves: ShelfRecords = NO_SHELVES) -> None:
    """Write the zip atomically. Raises `OSError`."""
    buffer, taken = io.BytesIO(), set[str]()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as zipped, matplotlib.rc_context(STYLE):

        def put(folder: str, title: str, ending: str, data: str | bytes) -> None:
            zipped.writestr(zipfile.ZipInfo(f"{folder}{title}.{ending}", EARLIEST), data, zipfile.ZIP_DEFLATED)

        for name, panel in figures(records):
            title, drawn = _free(name, taken), draw(panel)
            for ending in FORMATS:
                figure = io.BytesIO()
                dated = {"CreationDate": None} if ending == "pdf" else {"Date": None} if ending == "svg" else None
                drawn.savefig(figure, format=ending, dpi=DPI, metadata=dated)
                put("figures/", title, ending, figure.getvalue())
        for grid in tables(records, shelves):
            title = _free(grid.caption, taken)
            put("tables/", title, "csv", as_csv(grid))
            put("tables/", title, "tex", as_latex(grid))
        put("", "citation", "bib", bibtex(records))
    write_atomically(path, buffer.getvalue(), fsync=False)


def _free(title: str, taken: set[str]) -> str:
    plain = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:LONGEST_NAME] or "table"
    names = (plain, *(f"{plain}-{place}" for place in range(2, 1000)))
    name = next(name for name in names if name not in taken)
    taken.add(name)
    return name
