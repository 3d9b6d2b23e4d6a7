"""Studies and work–precision diagrams in a real browser: chosen without script, saved, readable on a phone."""

import re
import xml.etree.ElementTree as ET

import pytest

from reports.data.shelf_records import ShelfRecords
from reports.drawing.traces import rounded
from reports.run.run_page import write_page
from reports.studies.forest import forests
from reports.studies.study_page import shelf_shown, write_study_page
from tests.reports.browsing import opened, rows_of, saved, unfold
from tests.reports.fake_run import fake_records
from tests.reports.fake_studies import INTEREST, fake_studies, write_fake_studies

pytestmark = pytest.mark.slow

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    records = fake_records(tmp_path_factory.mktemp("studies") / "run")
    write_page(records, records.out / "report.html", ShelfRecords(evidence=fake_studies("evidence")))
    return (records.out / "report.html").as_uri()


def test_the_reader_chooses_the_visible_pair_of_error_and_cost(browser, address):
    view, noise = opened(browser, address)
    seen = "[...document.querySelectorAll('.choice')].filter(node => node.offsetHeight).map(node => node.className)"
    assert view.evaluate(seen) == ["choice rmse_linear-seconds"]
    for words in ("1 − SSIM", "network evaluations"):
        view.get_by_text(words, exact=True).first.click()
    assert view.evaluate(seen) == ["choice ssim-evaluations"]
    view.keyboard.press("ArrowLeft")
    assert view.evaluate(seen) == ["choice ssim-core_seconds"], "by keyboard as well"
    assert noise == []


def test_a_forest_is_saved_as_it_is_drawn_with_its_numbers(browser, address):
    view, _ = opened(browser, address)
    unfold(view)
    figure = view.locator("#study-factorial .forests figure").first
    (panel, *_) = forests(fake_studies("evidence").study("factorial").effects, INTEREST).values()
    rows = rows_of(saved(view, figure, "CSV"))
    tree = ET.fromstring(saved(view, figure, "SVG"))
    assert tree.tag == f"{SVG}svg"
    assert tree.find(f"{SVG}title").text.endswith("PSNR at equal steps, all scenes")
    words = {text for node in tree.iter(f"{SVG}text") for text in node.itertext()}
    assert {panel.rows[0], panel.figures[0]} <= words
    places = [float(value) for row in rows for value in row.values() if re.fullmatch(r"-?[\d.]+", value or "")]
    for trace in panel.traces:
        if trace.kind in ("range", "mark"):
            assert set(rounded(trace.x)) <= set(places), trace.label
    assert "var(" not in ET.tostring(tree, encoding="unicode")


def test_on_a_phone_no_outcome_needs_scrolling_and_the_matrix_names_its_subjects(browser, tmp_path):
    record = fake_studies("stability")
    out = write_fake_studies(tmp_path, record)
    address = write_study_page(shelf_shown(record, out), out).as_uri()
    view, _ = opened(browser, address, viewport={"width": 390, "height": 800})
    unfold(view)
    tables = "[...document.querySelectorAll('.matrix, .checks .scroll')]"
    over = f"{tables}.filter(node => node.scrollWidth > node.clientWidth).length"
    assert view.evaluate(over) == 0
    named = view.evaluate(
        "[...document.querySelectorAll('.matrix td[data-subject]')].map(o => getComputedStyle(o, '::before').content)"
    )
    assert '"midpoint" " "' in named or '"midpoint "' in named
    assert all(len(name) > 4 for name in named)
