"""The pages that can be opened from the repository are those that its published data give today."""

from pathlib import Path

import pytest

from reports.data.load import read_records
from reports.run.saving.archive import unpack, write_archive
from tests.harness.shell import ROOT
from tests.reports.fake_run import write_fake_run
from tools.published.web_pages import made, published

LARGEST = 6_000_000
"""Bytes: a page is loaded by a browser, and kept by git at every publication."""


@pytest.mark.slow
@pytest.mark.parametrize("page", published(ROOT / "docs"))
def test_a_page_is_what_the_data_give(page: str) -> None:
    content = (ROOT / "docs" / page).read_bytes()
    assert content == made(page, ROOT / "docs"), "python -m tools.published.web_pages"
    assert len(content) < LARGEST
    assert b"/tmp/" not in content


def test_an_archive_has_the_records_of_a_run_and_one_picture_per_scene_and_method(tmp_path: Path) -> None:
    records = read_records(write_fake_run(tmp_path / "run", ("chair", "lego"), seeds=2))
    for name in ("one.zip", "other.zip"):
        write_archive(records, tmp_path / name)
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "other.zip").read_bytes()
    unpack(tmp_path / "one.zip", tmp_path / "again")
    again = read_records(tmp_path / "again")
    assert (again.run, again.comparisons) == (records.run, records.comparisons)
    assert [cell.scores for cell in again.cells] == [cell.scores for cell in records.cells]
    pictured = [(cell.scene, cell.method) for cell in again.cells if cell.pictures]
    assert pictured
    assert len(set(pictured)) == len(pictured)
