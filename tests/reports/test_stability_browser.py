"""stability.html in a real browser: no noise, readable on a phone and in the dark, no failure out of sight."""

import pytest

from reports.stability_page import write_stability_page
from tests.reports.browsing import opened, unfold, weakest_contrast
from tests.reports.fake_stability import fake_stability, hostile, write_fake_stability
from tests.reports.menus import saveable
from tests.reports.test_page import HOSTILE

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    out = write_fake_stability(tmp_path_factory.mktemp("stability"))
    return write_stability_page(fake_stability(), out).as_uri()


def test_no_errors_and_no_requests(browser, address, tmp_path):
    spoiled = write_stability_page(hostile(fake_stability(), HOSTILE), write_fake_stability(tmp_path))
    for place in (address, spoiled.as_uri()):
        view, noise = opened(browser, place)
        unfold(view)
        assert noise == []
        assert view.evaluate("[...document.images].every(one => one.complete && one.naturalWidth > 0)")


@pytest.mark.parametrize("width", [360, 390, 768, 1300])
def test_the_page_is_never_wider_than_its_window(browser, address, width):
    view, _ = opened(browser, address, viewport={"width": width, "height": 800})
    unfold(view)
    assert view.evaluate("document.documentElement.scrollWidth") == width


def test_on_a_phone_no_outcome_needs_scrolling_and_the_matrix_names_its_subjects(browser, address):
    view, _ = opened(browser, address, viewport={"width": 390, "height": 800})
    unfold(view)
    tables = "[...document.querySelectorAll('.matrix, .findings .scroll, .case .scroll')]"
    over = f"{tables}.filter(one => one.scrollWidth > one.clientWidth).length"
    assert view.evaluate(over) == 0
    named = view.evaluate(
        "[...document.querySelectorAll('.matrix td[data-subject]')].map(o => getComputedStyle(o, '::before').content)"
    )
    assert '"midpoint" " "' in named or '"midpoint "' in named
    assert all(len(name) > 4 for name in named)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_own_ground(browser, address, scheme):
    view, _ = opened(browser, address, color_scheme=scheme)
    unfold(view)
    chosen = "p, td, th, small, summary, .chip, .chip *, .mark, .figure, .marks li, dd, dt, nav a, .plot text"
    ratio, text = weakest_contrast(view, chosen)
    assert ratio >= 4.5, text


def test_a_link_from_the_matrix_leads_to_its_case(browser, address):
    view, _ = opened(browser, address, viewport={"width": 1300, "height": 900}, reduced_motion="reduce")
    view.click("a[href='#case-Q1']")
    assert 0 <= view.locator("#case-Q1").bounding_box()["y"] < 900
    assert view.evaluate("document.querySelector('#case-Q1').closest('details').open")


def test_the_first_screen_names_the_failure(browser, address):
    view, _ = opened(browser, address, viewport={"width": 1300, "height": 1000})
    box = view.get_by_text("A2 harness").first.bounding_box()
    assert box is not None
    assert box["y"] + box["height"] < 500


def test_all_that_is_shown_can_be_saved(browser, address):
    view, _ = opened(browser, address)
    many = saveable(view)
    assert {kind for kind in many if many[kind]} == {"table", "chart", "picture"}
