"""The first screen, studies and work–precision diagrams in a real browser: visible, saved, readable on a phone."""

import re
import xml.etree.ElementTree as ET

import pytest

from reports.data.load import read_records
from reports.data.shelf_records import ShelfRecords
from reports.drawing.traces import rounded
from reports.run.run_page import write_page
from reports.studies.forest import forests
from reports.studies.study_page import shelf_shown, write_study_page
from tests.reports.browsing import address_of, opened, rows_of, saved, unfold
from tests.reports.fake_run import EIGHT, fake_records, write_fake_run
from tests.reports.fake_studies import INTEREST, fake_studies, write_fake_studies

pytestmark = pytest.mark.slow

LONG = "anameofsixtylettersinwhichthereisnoplaceatallwhereitcanbreak"
SVG = "{http://www.w3.org/2000/svg}"


def written(records, **shelves) -> str:
    write_page(records, records.out / "report.html", ShelfRecords(**shelves))
    return (records.out / "report.html").as_uri()


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> str:
    return written(fake_records(tmp_path_factory.mktemp("whole") / "run"), evidence=fake_studies("evidence"))


@pytest.fixture(scope="module")
def lengthy(tmp_path_factory) -> str:
    """Return a page with a long scene name in alerts, notes, figures and pictures."""
    return written(read_records(write_fake_run(tmp_path_factory.mktemp("lengthy") / "run", ("chair", LONG), size=16)))


def bottoms(view, selector) -> list[float]:
    return view.evaluate(
        "query => [...document.querySelectorAll(query)].map(node => node.getBoundingClientRect().bottom)", selector
    )


@pytest.mark.parametrize(("width", "height"), [(1280, 900), (390, 844)])
@pytest.mark.parametrize("page", ["whole", "lengthy"])
def test_the_most_important_is_visible_and_a_long_name_makes_no_page_wider_and_is_not_cut(
    browser, request, page, width, height
):
    view, _ = opened(browser, request.getfixturevalue(page), viewport={"width": width, "height": height})
    ends = bottoms(view, ".question, h1, .in-short > div")
    assert len(ends) == 5, "question, answer, confidence, scale, and what was not tested"
    assert max(ends) < height
    assert width < 900 or max(bottoms(view, ".principal tbody th"), default=0) < height
    unfold(view)
    assert view.evaluate("document.documentElement.scrollWidth") == width
    if page == "lengthy":
        cut = """[...document.querySelectorAll('.alert, .scroll:has(.principal), figcaption')]
            .filter(node => node.checkVisibility() && node.scrollWidth > node.clientWidth + 1)
            .map(node => node.textContent)"""
        assert view.evaluate(cut) == []
        for place in (".alert", "#convergence figcaption"):
            assert view.locator(place, has_text=LONG).count() > 0
    view.context.close()


def test_a_link_leads_to_its_section_and_unfolds_it(browser, whole):
    view, _ = opened(browser, whole, viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    for link in (".in-short a", "nav a >> nth=0"):
        view.evaluate("scrollTo(0, 0)")
        view.locator(link).click()
        assert address_of(view).endswith("not-tested")
        top = view.evaluate("document.getElementById('not-tested').getBoundingClientRect().top")
        assert 0 <= top < 900
    assert not view.evaluate("document.querySelector('#metrics > details').open")
    view.locator('nav a[href="#metrics"]').click()
    assert view.evaluate("document.querySelector('#metrics > details').open")
    view.context.close()
    view, _ = opened(browser, f"{whole}#provenance", viewport={"width": 1280, "height": 900})
    assert view.evaluate("document.querySelector('#provenance > details').open")
    assert not view.evaluate("document.querySelector('#metrics > details').open")
    view.context.close()


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


def test_eight_scenes_take_at_most_fifteen_screens(browser, tmp_path):
    address = written(read_records(write_fake_run(tmp_path / "run", EIGHT, size=16)))
    view, _ = opened(browser, address, viewport={"width": 1280, "height": 900})
    assert view.evaluate("document.documentElement.scrollHeight") <= 15 * 900
    view.context.close()


def test_the_reader_chooses_the_visible_pair_of_error_and_cost(browser, whole):
    view, noise = opened(browser, whole)
    seen = "[...document.querySelectorAll('.choice')].filter(node => node.offsetHeight).map(node => node.className)"
    assert view.evaluate(seen) == ["choice rmse_linear-seconds"]
    for words in ("1 − SSIM", "network evaluations"):
        view.get_by_text(words, exact=True).first.click()
    assert view.evaluate(seen) == ["choice ssim-evaluations"]
    view.keyboard.press("ArrowLeft")
    assert view.evaluate(seen) == ["choice ssim-core_seconds"], "by keyboard as well"
    assert noise == []


def test_a_forest_is_saved_as_it_is_drawn_with_its_numbers(browser, whole):
    view, _ = opened(browser, whole)
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
    address = write_study_page(shelf_shown(record), out).as_uri()
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
