"""What holds for every page: whole, self-contained, readable in the dark and on a phone, and to be saved."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from reports.data.beside import Beside
from reports.data.load import read_records
from reports.run.run_page import page
from reports.studies.study_page import study_page
from tests.reports.browsing import opened, unfold, weakest_contrast
from tests.reports.fake_evidence import fake_evidence
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_serving import fake_serving, write_fake_serving
from tests.reports.fake_shelf import hostile
from tests.reports.fake_speed import fake_speed
from tests.reports.fake_stability import fake_stability, write_fake_stability
from tests.reports.menus import saveable
from tests.reports.run.test_page import HOSTILE, Outline, foreign_scripts, without_code


def _report(out: Path) -> str:
    run = write_fake_serving(write_fake_run(out / "run", ("chair",), seeds=2))
    return page(read_records(run), Beside(evidence=fake_evidence(), serving=fake_serving()))


PAGES: dict[str, Callable[[Path], str]] = {
    "report": _report,
    "evidence": lambda out: study_page(fake_evidence(), out),
    "speed": lambda out: study_page(fake_speed(), out),
    "serving": lambda out: study_page(fake_serving(), write_fake_serving(out)),
    "hostile speed": lambda out: study_page(hostile(fake_speed(), HOSTILE), out),
    "stability": lambda out: study_page(fake_stability(), write_fake_stability(out)),
    "hostile stability": lambda out: study_page(hostile(fake_stability(), HOSTILE), write_fake_stability(out)),
}


@pytest.fixture(scope="module", params=PAGES)
def text(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    return PAGES[request.param](tmp_path_factory.mktemp("page"))


@pytest.fixture
def address(text: str, tmp_path: Path) -> str:
    (tmp_path / "page.html").write_text(text, encoding="utf-8")
    return (tmp_path / "page.html").as_uri()


def test_it_is_well_formed_fetches_nothing_and_runs_no_script_but_ours(text):
    outline = Outline(text)
    assert len(outline.ids) == len(set(outline.ids))
    links = [link for link in outline.links if not link.startswith("data:")]
    assert {link[1:] for link in links if link.startswith("#")} <= set(outline.ids)
    assert {link for link in links if not link.startswith("#")} <= {"serving.html"}, "the page beside the report"
    assert re.findall(r"url\(\s*[\"']?(?!#)", text) == []
    assert "@import" not in text
    assert foreign_scripts(text) == []
    assert text.index("Content-Security-Policy") < text.index("<style>")


def test_no_number_is_nan_or_infinite(text):
    visible = re.sub(r"<style.*?</style>|<[^>]*>", " ", without_code(text), flags=re.DOTALL)
    visible = visible.replace("the figure is nan", "")
    assert re.findall(r"\b(?:nan|inf|Infinity|None)\b", visible) == []


@pytest.mark.slow
def test_it_asks_for_nothing_fits_a_phone_and_everything_can_be_saved(browser, address):
    view, noise = opened(browser, address, viewport={"width": 360, "height": 800})
    unfold(view)
    assert noise == []
    assert view.evaluate("[...document.images].every(one => one.complete && one.naturalWidth > 0)")
    assert view.evaluate("document.documentElement.scrollWidth") == 360
    assert saveable(view)["table"] > 0
    view.context.close()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(browser, address, scheme):
    view, _ = opened(browser, address, color_scheme=scheme)
    unfold(view)
    ratio, words = weakest_contrast(view, "h1, p, td, th, small, figcaption, summary, nav a, .plot text")
    assert ratio >= 4.5, words
    view.context.close()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_to_complain_of(browser, address, scheme):
    from axe_playwright_python.sync_playwright import Axe

    view, _ = opened(browser, address, viewport={"width": 1280, "height": 900}, color_scheme=scheme)
    if view.locator("#psnr tbody .behind").count():
        view.locator("#psnr tbody .behind").first.click()
    unfold(view)
    found = Axe().run(view).response["violations"]
    assert [(each["id"], node["html"][:120]) for each in found for node in each["nodes"]] == []
    view.context.close()
