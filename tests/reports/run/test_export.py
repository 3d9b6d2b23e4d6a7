"""The zip of a run holds every table and figure of its page, their exact numbers, and the citation."""

import csv
import io
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from reports.data.load import read_records
from reports.run.run_page import page
from reports.run.saving.citation import bibtex, records_digest
from reports.run.saving.export import write_export
from tests.reports.fake_run import write_fake_run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_fake_run(tmp_path_factory.mktemp("run"), scenes=("lego", "ship"), seeds=1, pictures=False)


@pytest.fixture(scope="module")
def shown(run: Path) -> str:
    return page(read_records(run))


@pytest.fixture(scope="module")
def zipped(run: Path) -> zipfile.ZipFile:
    write_export(read_records(run), run / "all.zip")
    return zipfile.ZipFile(run / "all.zip")


def test_every_table_of_the_page_is_in_it(shown: str, zipped: zipfile.ZipFile) -> None:
    def plain(caption: str) -> str:
        return re.sub(r"[^a-z0-9]+", "-", caption.lower()).strip("-")

    captions = re.findall(r"<caption[^>]*>([^<]*)</caption>", shown)
    own = {plain(caption) for caption in captions if "Claimed and measured" not in caption}
    ruler = "What is to be expected of scenes like these? Difference in mean test PSNR, 95 % interval, sign and size"
    own -= {plain(ruler), plain("At what scale")}
    files = {Path(name).stem for name in zipped.namelist() if name.startswith("tables/")}
    assert own <= {re.sub(r"-\d+$", "", name) for name in files} | files


def test_every_drawing_is_there_in_three_formats(shown: str, zipped: zipfile.ZipFile) -> None:
    drawn = [Path(name) for name in zipped.namelist() if name.startswith("figures/")]
    stems = {path.stem for path in drawn}
    assert len(drawn) == 3 * len(stems)
    assert shown.count("<figure>") <= len(stems)
    starts = {".pdf": b"%PDF", ".png": b"\x89PNG", ".svg": b"<?xml"}
    assert all(zipped.read(str(path)).startswith(starts[path.suffix]) for path in drawn)


def test_a_csv_holds_the_exact_numbers(run: Path, zipped: zipfile.ZipFile) -> None:
    rows = list(csv.DictReader(io.StringIO(zipped.read("tables/test-psnr.csv").decode())))
    lego = next(row for row in rows if row["scene"] == "lego")
    records = read_records(run)
    cells = [cell.scores["psnr"] for cell in records.cells_of("lego", "nerf")]
    assert float(lego["nerf"]) == pytest.approx(sum(cells) / len(cells), rel=1e-12)
    assert "\\toprule" in zipped.read("tables/test-psnr.tex").decode()


def test_the_same_run_gives_the_same_tables_and_drawings(run: Path, zipped: zipfile.ZipFile) -> None:
    with np.printoptions(legacy="1.13"):  # as colour-science sets it when it is imported
        write_export(read_records(run), run / "again.zip")
    again = zipfile.ZipFile(run / "again.zip")
    assert again.namelist() == zipped.namelist()
    for name in zipped.namelist():
        if not name.endswith(".svg"):  # Matplotlib draws random ids
            assert again.read(name) == zipped.read(name), name


def test_a_citation_names_the_records_and_no_others(run: Path, zipped: zipfile.ZipFile) -> None:
    records = read_records(run)
    text = bibtex(records)
    assert zipped.read("citation.bib").decode() == text
    assert f"@misc{{radiance-verdict-{records_digest(records)[:12]}," in text
    assert text.count("{") == text.count("}")
    assert not re.search(r"(?<!\\)[%&#$_]", text)
    assert records_digest(records) == records_digest(read_records(run))
    records.cells[0] = replace(records.cells[0], steps=1)
    assert records_digest(records) != records_digest(read_records(run))
