"""speed.html in a real browser: no errors, no requests, the outcome on the first screen, also on a phone."""

import pytest

from reports.speed_page import write_speed_page
from tests.reports.browsing import opened, unfold, weakest_contrast
from tests.reports.fake_speed import fake_speed, hostile
from tests.reports.menus import saveable
from tests.reports.test_page import HOSTILE

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("speed") / "speed.html"
    write_speed_page(fake_speed(), path)
    return path.as_uri()


def test_no_errors_and_no_requests(browser, address, tmp_path):
    write_speed_page(hostile(fake_speed(), HOSTILE), tmp_path / "hostile.html")
    for place in (address, (tmp_path / "hostile.html").as_uri()):
        view, noise = opened(browser, place)
        unfold(view)
        assert noise == []


def test_every_target_stands_on_the_first_screen(browser, address):
    view, _ = opened(browser, address, viewport={"width": 1300, "height": 1000})
    assert view.inner_text("h1") == "5 of 9 speed targets met, 2 missed, 2 without a figure"
    box = view.locator(".aims tbody tr").last.bounding_box()
    assert box is not None
    assert box["y"] + box["height"] < 1000


@pytest.mark.parametrize("width", [360, 768, 1300])
def test_no_outcome_is_out_of_sight(browser, address, width):
    view, _ = opened(browser, address, viewport={"width": width, "height": 800})
    assert view.evaluate("document.documentElement.scrollWidth") == width
    edges = "[...document.querySelectorAll('.aims .outcome')].map(one => one.getBoundingClientRect().right)"
    found = view.evaluate(edges)
    assert len(found) == 9
    assert max(found) <= width
    wanted = view.evaluate("[...document.querySelectorAll('.aims tr')].map(one => one.innerText)")
    assert "≥ 10×" in wanted[1]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_and_lines_stand_out_from_their_ground(browser, address, scheme):
    view, _ = opened(browser, address, color_scheme=scheme)
    ratio, text = weakest_contrast(view, "p, td, th, small, .outcome, nav a, .legend span, .plot text")
    assert ratio >= 4.5, text


def test_met_and_missed_differ_by_more_than_colour(browser, address):
    view, _ = opened(browser, address)
    marks = view.evaluate(
        "[...document.querySelectorAll('.aims .outcome')].map(one => getComputedStyle(one, '::before').content[1])"
    )
    assert marks == ["✕", "✓", "✓", "✓", "?", "✓", "?", "✓", "✕"]


def test_all_that_is_shown_can_be_saved(browser, address):
    view, _ = opened(browser, address)
    many = saveable(view)
    assert {kind for kind in many if many[kind]} == {"table", "chart"}
