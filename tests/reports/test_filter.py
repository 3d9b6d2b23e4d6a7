"""What the filter takes out of sight besides rows and drawings: pictures, and runs to choose from, in a browser."""

import pytest

from reports.load import read_records
from reports.page import write_page
from tests.reports.browsing import address_of, opened, until
from tests.reports.comparer_view import ready, settle

pytestmark = pytest.mark.slow

SCENES, METHODS = ["chair", "drums"], ["nerf", "nerf_matched", "qnerf"]


@pytest.fixture(scope="module")
def address(pictured, tmp_path_factory):
    path = tmp_path_factory.mktemp("filter") / "report.html"
    write_page(read_records(pictured), path)
    return path.as_uri()


def options(view, selector):
    return view.eval_on_selector_all(f"{selector} option", "all => all.map(one => one.value)")


def columns(view):
    return view.locator("#comparer .pane .who").all_inner_texts()


def test_the_comparer_shows_the_scenes_and_methods_that_are_left(browser, address):
    view, noise = ready(browser, address, "at=pictures&scene=chair&filter.scenes=drums&filter.methods=qnerf")
    assert columns(view) == ["ground truth", "qnerf"]
    assert options(view, "#comparer select[aria-label=Scene]") == ["drums"]
    assert "chair is filtered out; shown is drums." in view.inner_text(".notes")
    view.locator("#comparer .stage").focus()
    view.keyboard.press("w")
    settle(view)
    assert options(view, "#comparer select[aria-label=B]") == ["truth", "qnerf"]
    view.keyboard.press("s")
    view.locator(".tool", has_text="Filter").click()
    view.get_by_role("button", name="show all").click()
    settle(view)
    assert columns(view) == ["ground truth", *METHODS]
    assert options(view, "#comparer select[aria-label=Scene]") == SCENES
    view.locator(".filter label", has_text="nerf_matched").locator("input").click()
    settle(view)
    assert columns(view) == ["ground truth", "nerf", "qnerf"]
    assert "filter.methods=nerf%2Cqnerf" in address_of(view)
    assert noise == []


def test_what_was_compared_and_is_filtered_out_leaves_a_valid_pair(browser, address):
    view, noise = ready(browser, address, "at=pictures&compare.mode=wipe&compare.a=nerf&compare.b=nerf_matched&"
                                          "compare.pixel=3,3&filter.methods=qnerf")  # fmt: skip
    assert columns(view) == ["ground truth", "qnerf"]
    assert view.locator(".probe tbody tr").count() == 2
    assert noise == []


def test_the_density_figure_shows_what_is_left_or_nothing(browser, address):
    view, noise = opened(browser, address, reduced_motion="reduce")
    view.evaluate("location.hash = 'filter.scenes=drums&scene=chair'")
    drawn = "document.querySelector('.density svg.plot').ariaLabel"
    until(view, f"{drawn}.startsWith('drums, qnerf, seed 0')")
    assert options(view, "select[name=density-scene]") == ["drums"]
    for left, seen in (("filter.methods=nerf", "none"), ("filter.methods=qnerf", "block")):
        view.evaluate(f"location.hash = '{left}'")
        until(view, f"getComputedStyle(document.querySelector('.density')).display === '{seen}'")
    assert options(view, "select[name=density-scene]") == SCENES
    assert noise == []
