"""The studies and the work–precision diagrams in a real browser: chosen without a script, readable in the dark and on a
phone."""

import re
import xml.etree.ElementTree as ET

import pytest

from reports.data.beside import Beside
from reports.data.load import read_records
from reports.drawing.traces import rounded
from reports.run.run_page import write_page
from reports.studies.forest import forests
from tests.reports.browsing import opened
from tests.reports.exploring import rows_of, saved
from tests.reports.fake_evidence import INTEREST, fake_evidence
from tests.reports.fake_run import write_fake_run

pytestmark = pytest.mark.slow

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    out = write_fake_run(tmp_path_factory.mktemp("evidence") / "run", pictures=False)
    write_page(read_records(out), out / "report.html", Beside(evidence=fake_evidence()))
    return (out / "report.html").as_uri()


def shown(view) -> list[str]:
    return view.evaluate(
        "[...document.querySelectorAll('.choice')].filter(one => one.offsetHeight).map(one => one.className)"
    )


def test_one_pair_of_error_and_cost_is_seen_and_the_reader_chooses_which(browser, address):
    view, noise = opened(browser, address)
    assert shown(view) == ["choice rmse_linear-seconds"]
    view.get_by_text("1 − SSIM", exact=True).first.click()
    view.get_by_text("network evaluations", exact=True).first.click()
    assert shown(view) == ["choice ssim-evaluations"]
    view.keyboard.press("ArrowLeft")
    assert shown(view) == ["choice ssim-seconds"], "by keyboard as well"
    assert noise == []


def test_a_forest_is_saved_as_it_is_drawn_with_its_numbers(browser, address):
    view, _ = opened(browser, address)
    figure = view.locator("#study-factorial .forests figure").first
    drawn = next(one for one in fake_evidence().studies if one.info.id == "factorial")
    (panel, *_) = forests(drawn.effects, INTEREST).values()
    rows = rows_of(saved(view, figure, "CSV"))
    tree = ET.fromstring(saved(view, figure, "SVG"))
    assert tree.find(f"{SVG}title").text.endswith("PSNR at equal steps, all scenes")
    words = {text for one in tree.iter(f"{SVG}text") for text in one.itertext()}
    assert {panel.rows[0], panel.figures[0]} <= words
    places = [float(value) for row in rows for value in row.values() if re.fullmatch(r"-?[\d.]+", value or "")]
    for trace in panel.traces:
        if trace.kind in ("range", "mark"):
            assert set(rounded(trace.x)) <= set(places), trace.label
    assert "var(" not in ET.tostring(tree, encoding="unicode")
