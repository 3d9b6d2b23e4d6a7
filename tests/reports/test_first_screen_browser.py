"""The first screen in a real browser: its visible parts, the files of its tables, and long names."""

import re

import pytest

from reports.data.load import read_records
from reports.run.run_page import write_page
from tests.reports.browsing import address_of, opened, rows_of, saved, unfold
from tests.reports.fake_run import EIGHT, write_fake_run

pytestmark = pytest.mark.slow

LONG = "anameofsixtylettersinwhichthereisnoplaceatallwhereitcanbreak"


def written(folder, *scenes, **options) -> str:
    write_page(read_records(write_fake_run(folder / "run", scenes, size=16, **options)), folder / "report.html")
    return (folder / "report.html").as_uri()


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> str:
    return written(tmp_path_factory.mktemp("whole"), "chair", "drums", pictures=False, with_diverged=False)


@pytest.fixture(scope="module")
def lengthy(tmp_path_factory) -> str:
    """Return a page with a long scene name in alerts, notes, figures and pictures."""
    return written(tmp_path_factory.mktemp("lengthy"), "chair", LONG)


def bottoms(view, selector) -> list[float]:
    return view.evaluate(
        "query => [...document.querySelectorAll(query)].map(node => node.getBoundingClientRect().bottom)", selector
    )


@pytest.mark.parametrize(("width", "height"), [(1280, 900), (390, 844)])
def test_question_answer_confidence_scale_and_what_was_not_tested_are_visible(browser, whole, lengthy, width, height):
    for address in (whole, lengthy):
        view, _ = opened(browser, address, viewport={"width": width, "height": height})
        ends = bottoms(view, ".question, h1, .in-short > div")
        assert len(ends) == 5
        assert max(ends) < height
        assert width < 900 or max(bottoms(view, ".principal tbody th"), default=0) < height
        view.context.close()


def test_what_was_not_tested_is_a_click_away(browser, whole):
    view, _ = opened(browser, whole, viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    for link in (".in-short a", "nav a >> nth=0"):
        view.evaluate("scrollTo(0, 0)")
        view.locator(link).click()
        assert address_of(view).endswith("not-tested")
        top = view.evaluate("document.getElementById('not-tested').getBoundingClientRect().top")
        assert 0 <= top < 900


def test_each_claim_is_saved_as_a_row_with_numbers_that_parse(browser, whole):
    view, _ = opened(browser, whole)
    tools = view.locator(".scroll:has(.principal) + .tools, .tools:has(+ .scroll .principal)")
    rows = rows_of(saved(view, tools, "CSV"))
    assert [row["claim"] for row in rows] == view.locator(".principal tbody th").all_inner_texts()
    by_claim = {row["claim"]: row for row in rows}
    average, weights = (by_claim[name] for name in ("PSNR gain, average", "weights of Table 1, counted"))
    assert (average["claimed"], average["claimed unit"]) == ("1.5", "dB")
    assert [round(float(average[f"measured{end}"]), 2) for end in ("", " low", " high")] == [0.81, 0.76, 0.86]
    assert (weights["claimed"], weights["measured"]) == ("1370000", "546566")
    figures = [
        row[name] for row in rows for name in row if re.fullmatch(r"(claimed|measured)( from| to| low| high)?", name)
    ]
    assert [float(figure) for figure in figures if figure]


@pytest.mark.parametrize("width", [390, 1280])
def test_a_long_name_makes_no_page_wider_and_is_not_cut(browser, lengthy, width):
    view, _ = opened(browser, lengthy, viewport={"width": width, "height": 844})
    unfold(view)
    assert view.evaluate("document.documentElement.scrollWidth") == width
    cut = """[...document.querySelectorAll('.alert, .scroll:has(.principal), figcaption')]
        .filter(node => node.checkVisibility() && node.scrollWidth > node.clientWidth + 1)
        .map(node => node.textContent)"""
    assert view.evaluate(cut) == []
    for place in (".alert", "#convergence figcaption"):
        assert view.locator(place, has_text=LONG).count() > 0


def test_eight_scenes_take_at_most_fifteen_screens(browser, tmp_path):
    address = written(tmp_path, *EIGHT)
    view, _ = opened(browser, address, viewport={"width": 1280, "height": 900})
    assert view.evaluate("document.documentElement.scrollHeight") <= 15 * 900
    view.context.close()
    view, _ = opened(browser, address, viewport={"width": 390, "height": 844})
    assert view.evaluate("document.documentElement.scrollWidth") == 390
    view.context.close()


def test_a_link_unfolds_the_section_that_it_leads_to(browser, whole):
    view, _ = opened(browser, whole, viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    assert not view.evaluate("document.querySelector('#metrics > details').open")
    view.locator('nav a[href="#metrics"]').click()
    assert view.evaluate("document.querySelector('#metrics > details').open")
    view.context.close()
    view, _ = opened(browser, f"{whole}#provenance", viewport={"width": 1280, "height": 900})
    assert view.evaluate("document.querySelector('#provenance > details').open")
    assert not view.evaluate("document.querySelector('#metrics > details').open")
    view.context.close()
