"""Every page is well-formed, self-contained, readable in dark mode and on a phone, and can be saved."""

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from harness.records.study import Studies, read_studies
from harness.verdicts.judging.judgement import judge
from harness.verdicts.tables.result_table import read_table
from reports.data.load import read_records
from reports.data.studies_load import ShelfRecords
from reports.run.run_page import page
from reports.studies.judgement import judgement_page
from reports.studies.study_page import shelf_shown, study_page
from tests.harness.shell import ROOT
from tests.replacing import replace
from tests.reports.browsing import CONTRAST, opened, unfold
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_studies import fake_studies, hostile, write_fake_studies
from tests.reports.run.test_page import HOSTILE, Outline, foreign_scripts, without_code

OFFERED = """() => {
    const offered = button => {
        if (!button) return '';
        button.click();
        const forms = [...document.querySelectorAll('.menu button')].map(item => item.textContent).join(' ');
        button.click();
        return forms;
    };
    const counts = node => !node.closest('.panel, #pictures, [aria-hidden] .pen');
    const toolsOf = table => {
        const place = table.closest('.scroll') ?? table;
        return [place.previousElementSibling, place.nextElementSibling].find(node => node?.matches('.tools'));
    };
    const tables = [...document.querySelectorAll('table')].filter(counts).map(table => [
        'table', table.caption?.textContent ?? 'no caption', offered(toolsOf(table)?.querySelector('.save'))]);
    const figures = [...document.querySelectorAll('figure:has(svg, img, canvas)')].filter(counts).map(figure => [
        figure.querySelector('img') ? 'picture' : 'chart',
        figure.querySelector('figcaption')?.textContent ?? 'no caption', offered(figure.querySelector('.save'))]);
    const drawings = [...document.querySelectorAll('svg:not(.pen), canvas, img')].filter(counts);
    const stray = drawings.filter(node => !node.closest('figure, table'))
        .map(node => ['stray', node.outerHTML.slice(0, 80), '']);
    return [...tables, ...figures, ...stray];
}"""
FORMS = {"table": "CSV Markdown LaTeX", "chart": "SVG CSV", "picture": "PNG", "stray": "a figure or a table around it"}


def _report(out: Path) -> str:
    run = write_fake_studies(write_fake_run(out / "run", ("chair",), seeds=2), "serving")
    return page(read_records(run), ShelfRecords(evidence=fake_studies("evidence"), serving=fake_studies("serving")))


def _studies(record: Studies, out: Path) -> str:
    return study_page(shelf_shown(record))


def _unfinished(out: Path) -> str:
    records = read_records(write_fake_run(out / "run", ("chair",), seeds=2))
    return page(replace(records, run=replace(records.run, finished=False)))


LEADERBOARD, FRONTIER = ROOT / "docs/examples/nerfbaselines-blender.csv", ROOT / "docs/frontier/frontier.json"
PAGES: dict[str, Callable[[Path], str]] = {
    "report": _report,
    "unfinished": _unfinished,
    "judgement": lambda _: judgement_page(judge(read_table([LEADERBOARD]), None, None)),
    "frontier": lambda _: study_page(shelf_shown(read_studies(FRONTIER))),
} | {
    f"{kind}{shelf}": partial(_studies, change(fake_studies(shelf, failing=True)))
    for kind, change in (("", lambda record: record), ("hostile ", partial(hostile, word=HOSTILE)))
    for shelf in ("evidence", "speed", "serving", "stability")
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
    unfinished = 'id="version-data"' in text  # only such a page asks for a newer one
    assert foreign_scripts(text, files=unfinished) == []
    assert {"iframe", "object"}.isdisjoint(outline.tags)
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
    assert view.evaluate("[...document.images].every(image => image.complete && image.naturalWidth > 0)")
    assert view.evaluate("document.documentElement.scrollWidth") == 360
    offered = view.evaluate(OFFERED)
    assert [(kind, name, forms) for kind, name, forms in offered if forms != FORMS[kind]] == []
    assert any(kind == "table" for kind, _, _ in offered)
    view.context.close()


@pytest.mark.slow
def test_text_has_contrast_and_axe_finds_no_violation(browser, address):
    from axe_playwright_python.sync_playwright import Axe

    view, _ = opened(browser, address, viewport={"width": 1280, "height": 900})
    if view.locator("#psnr tbody .behind").count():
        view.locator("#psnr tbody .behind").first.click()
    unfold(view)
    for scheme in ("light", "dark"):
        view.emulate_media(color_scheme=scheme)
        ratio, words = view.evaluate(CONTRAST, "h1, p, td, th, small, figcaption, summary, nav a, .plot text")
        assert ratio >= 4.5, (scheme, words)
        violations = Axe().run(view).response["violations"]
        assert [(each["id"], node["html"][:120]) for each in violations for node in each["nodes"]] == [], scheme
    view.context.close()
