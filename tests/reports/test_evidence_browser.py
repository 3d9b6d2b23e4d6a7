"""The studies and the work–precision diagrams in a real browser: chosen without a script, readable in the dark and on a
phone."""

import pytest

from reports.beside import Beside
from reports.load import read_records
from reports.page import write_page
from tests.reports.browsing import opened, unfold, weakest_contrast
from tests.reports.fake_evidence import fake_evidence
from tests.reports.fake_run import write_fake_run

pytestmark = pytest.mark.slow


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
    assert shown(view) == ["choice rmse-seconds"]
    view.get_by_text("1 − SSIM", exact=True).first.click()
    view.get_by_text("network evaluations", exact=True).first.click()
    assert shown(view) == ["choice dssim-evaluations"]
    view.keyboard.press("ArrowLeft")
    assert shown(view) == ["choice dssim-seconds"], "by keyboard as well"
    assert noise == []


@pytest.mark.parametrize("width", [360, 768, 1300])
def test_the_page_is_never_wider_than_its_window(browser, address, width):
    view, _ = opened(browser, address, viewport={"width": width, "height": 800})
    unfold(view)
    assert view.evaluate("document.documentElement.scrollWidth") == width


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(browser, address, scheme):
    view, _ = opened(browser, address, color_scheme=scheme)
    ratio, text = weakest_contrast(
        view, "#evidence td, #evidence th, #evidence p, .tabs label, .tabs legend, .axis span"
    )
    assert ratio >= 4.5, text


def test_bars_of_a_forest_lie_within_its_column(browser, address):
    view, _ = opened(browser, address)
    outside = """[...document.querySelectorAll('.forest .drawn i')].filter(one => {
        const bar = one.getBoundingClientRect(), cell = one.closest('td').getBoundingClientRect();
        return cell.width && (bar.left < cell.left - 1 || bar.right > cell.right + 1);
    }).length"""
    assert view.evaluate(outside) == 0
    assert view.evaluate("document.querySelectorAll('.forest .dot').length") > 40
