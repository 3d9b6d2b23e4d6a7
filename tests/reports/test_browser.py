"""The page in a real browser: no errors, no requests, readable in the dark and on a phone."""

import pytest

from reports.load import read_records
from reports.page import write_page
from tests.reports.browsing import opened, unfold, weakest_contrast

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(pictured, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_page(read_records(pictured), path)
    return path.as_uri()


def test_no_errors_and_no_requests(browser, address):
    view, noise = opened(browser, address)
    unfold(view)
    assert noise == []
    broken = "[...document.images].filter(one => !one.complete || one.naturalWidth === 0).length"
    assert view.evaluate(broken) == 0


def test_the_first_screen_tells_the_result(browser, address):
    view, _ = opened(browser, address, viewport={"width": 1300, "height": 1000})
    assert view.inner_text("h1") == "qnerf lost 1 of its 6 cells: against nerf nothing is settled"
    for words in ("at equal training time", "against nerf_matched", "this run", "did not finish"):
        box = view.get_by_text(words).first.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] < 1000, words


@pytest.mark.parametrize("width", [360, 768, 1300])
def test_the_page_is_never_wider_than_its_window(browser, address, width):
    view, _ = opened(browser, address, viewport={"width": width, "height": 800})
    assert view.evaluate("document.documentElement.scrollWidth") == width


def test_plots_have_a_size_and_a_description(browser, address):
    view, _ = opened(browser, address)
    sizes = view.evaluate(
        "[...document.querySelectorAll('main section > .plots svg')].map(one => one.getBoundingClientRect().height)"
    )
    assert len(sizes) > 10
    assert min(sizes) > 80
    drawn = "[...document.querySelectorAll('svg:not([aria-hidden]), img')]"
    assert view.evaluate(f"{drawn}.every(one => one.ariaLabel || one.alt)")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(browser, address, scheme):
    view, _ = opened(browser, address, color_scheme=scheme)
    ratio, text = weakest_contrast(view, "h1 b, p b, td, th, small, .note, nav a, summary, .plot text")
    assert ratio >= 4.5, text
