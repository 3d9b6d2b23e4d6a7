"""A page to explore in a browser: two scenes, one of them with a hostile name, and what is downloaded from it."""

import csv
import io
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from harness.records.cells import CellRecord
from reports.data.load import Records, read_records
from reports.run.run_page import write_page
from tests.reports.fake_run import write_fake_run

HOSTILE = '"><img src=x onerror=alert(1)>'
FORMULA = "=cmd()"
MACRO = "\\input{secret} | 5_% < 6"


def with_warnings(cell: CellRecord) -> CellRecord:
    """Words that a spreadsheet, LaTeX or Markdown would take for their own."""
    return replace(cell, warnings=[FORMULA, MACRO] if cell.seed == 0 else [])


def write_exploring(folder: Path) -> tuple[Records, str]:
    """The records, and the page's address."""
    out = write_fake_run(folder / "run", ("chair", HOSTILE), pictures=False, change_cell=with_warnings)
    records = read_records(out)
    write_page(records, folder / "report.html")
    return records, (folder / "report.html").as_uri()


def saved(view: Any, owner: Any, kind: str) -> str:
    """What the menu of `owner` gives as `kind`."""
    owner.locator(".save").first.click()
    with view.expect_download() as download:
        view.get_by_role("menuitem", name=kind, exact=True).click()
    return Path(download.value.path()).read_bytes().decode("utf-8")


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text, newline="")))
