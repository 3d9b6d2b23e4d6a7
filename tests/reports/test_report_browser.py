"""A report in a real browser: what is visible at first, its tables, its figures, and the runs behind them."""

import re
import xml.etree.ElementTree as ET

import pytest

from harness.verdicts.comparisons import scores_at
from reports.data.load import read_records
from reports.data.studies_load import ShelfRecords
from reports.drawing.traces import rounded
from reports.run.run_page import write_page
from reports.studies.forest import forests
from reports.studies.study_page import shelf_shown, write_study_page
from tests.replacing import replace
from tests.reports.browsing import address_of, opened, rows_of, saved, unfold, until
from tests.reports.fake_run import EIGHT, fake_records, write_fake_run
from tests.reports.fake_studies import INTEREST, fake_studies
from tests.reports.test_tables import HOSTILE

pytestmark = pytest.mark.slow

LONG = "anameofsixtylettersinwhichthereisnoplaceatallwhereitcanbreak"
SVG = "{http://www.w3.org/2000/svg}"
FORMULA, MACRO = "=cmd()", "\\input{secret} | 5_% < 6"
"""Texts with special characters of spreadsheets, LaTeX and Markdown."""


def with_warnings(cell):
    return replace(cell, warnings=[FORMULA, MACRO] if cell.seed == 0 else [])


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    options = {"scenes": ("chair", HOSTILE), "with_diverged": True, "change_cell": with_warnings}
    return fake_records(tmp_path_factory.mktemp("explored") / "run", **options)


def written(records, **shelves):
    write_page(records, records.out / "report.html", ShelfRecords(**shelves))
    return (records.out / "report.html").as_uri()


@pytest.fixture(scope="module")
def address(records):
    return written(records, evidence=fake_studies("evidence"))


@pytest.fixture(scope="module")
def lengthy(tmp_path_factory):
    """Return a page with a long scene name in alerts, notes, figures and pictures."""
    return written(read_records(write_fake_run(tmp_path_factory.mktemp("lengthy") / "run", ("chair", LONG), size=16)))


@pytest.fixture
def view(browser, address):
    page, noise = opened(browser, address, viewport={"width": 1400, "height": 900}, reduced_motion="reduce")
    page.set_default_timeout(8000)
    yield page
    assert [line for line in noise if not line.startswith("blob:")] == []
    page.context.close()


def tools(view, section):
    unfold(view)
    return view.locator(f"#{section} .tools").first


def column(view, section, place):
    return view.evaluate(
        """([section, place]) => [...document.querySelector(`#${section} table`).tBodies[0].rows]
            .filter(row => row.offsetParent).map(row => row.cells[place])
            .map(cell => cell.dataset.value ?? cell.innerText)""",
        [section, place],
    )


def test_a_table_is_saved_with_the_numbers_of_the_records_and_for_markdown_and_latex(view, records):
    rows = rows_of(saved(view, tools(view, "psnr"), "CSV"))
    gain, spent = "gain of the last doubling, dB", "training of a cell"
    assert [row["scene"] for row in rows] == ["chair", HOSTILE, "mean", gain, spent]
    for method in records.methods:
        scores = [cell.scores["psnr"] for cell in records.cells_of("chair", method)]
        assert float(rows[0][method]) == pytest.approx(sum(scores) / len(scores), rel=1e-6)
        assert float(rows[0][f"{method} sd"]) > 0
    claims = view.locator(".scroll:has(.principal) + .tools, .tools:has(+ .scroll .principal)")
    claim = rows_of(saved(view, claims, "CSV"))[0]
    assert (claim["claim"], claim["claimed"], claim["claimed unit"]) == ("PSNR gain, average", "1.5", "dB")
    assert float(claim["measured low"]) < float(claim["measured"]) < float(claim["measured high"])
    markdown = saved(view, tools(view, "psnr"), "Markdown").splitlines()
    assert markdown[0] == "**Test PSNR**"
    assert markdown[2].startswith("| scene | nerf | qnerf | nerf\\_matched | floor (copy the nearest view) |")
    assert markdown[3].startswith("| :--- | ---: | ---: |")
    assert markdown[4].startswith("| chair | 22.87 ± 0.02 (train 23.97) |")
    latex = saved(view, tools(view, "psnr"), "LaTeX").splitlines()
    assert latex[3] == "\\caption{Test PSNR}"
    assert latex[6].startswith("scene & nerf & qnerf & nerf\\_matched & floor (copy the nearest view) &")
    assert latex[8].startswith("chair & 22.87 $\\pm$ 0.02 (train 23.97) &")
    assert [line for line in latex if line.endswith("rule")] == ["\\toprule", "\\midrule", "\\midrule", "\\bottomrule"]


def test_a_menu_works_with_keys_and_escape_closes_only_the_menu(view):
    view.locator("#psnr tbody .behind").first.click()
    button = view.locator("#psnr .save").first
    button.focus()
    for key, focused in (("Enter", "CSV"), ("ArrowUp", "LaTeX"), ("ArrowDown", "CSV")):
        view.keyboard.press(key)
        until(view, f"document.activeElement.textContent === '{focused}'")
    view.keyboard.press("Escape")
    until(view, "document.activeElement.matches('#psnr .save')")
    assert view.locator("#runs").is_visible()
    assert view.locator(".menu").is_hidden()


def test_formulas_and_macros_in_data_are_harmless_in_files(view):
    rows = rows_of(saved(view, tools(view, "warnings"), "CSV"))
    assert {row["warning"] for row in rows} == {f"'{FORMULA}", MACRO}
    markdown = saved(view, tools(view, "warnings"), "Markdown")
    assert "\\\\input{secret} \\| 5\\_% &lt; 6 |" in markdown
    assert "<img" not in markdown
    latex = saved(view, tools(view, "warnings"), "LaTeX")
    assert "\\textbackslash{}input\\{secret\\} $|$ 5\\_\\% $<$ 6 \\\\" in latex
    assert "''$>$$<$img src=x" in latex


def test_a_header_sorts_by_value_and_back_and_the_address_keeps_it(view, browser):
    unfold(view)
    before = column(view, "comparisons", 4)
    header = view.locator("#comparisons th .sort").nth(4)
    header.focus()
    view.keyboard.press("Enter")
    falling = [float(value) for value in column(view, "comparisons", 4)]
    assert falling == sorted(falling, reverse=True)
    assert falling[-1] < 0 < falling[0]
    assert view.locator("#comparisons th").nth(4).get_attribute("aria-sort") == "descending"
    again, _ = opened(browser, address_of(view))
    again.evaluate("document.querySelector('#comparisons details details').open = true")
    assert [float(value) for value in column(again, "comparisons", 4)] == falling, "its section is unfolded"
    again.context.close()
    header.click()
    assert [float(value) for value in column(view, "comparisons", 4)] == falling[::-1]
    header.click()
    assert column(view, "comparisons", 4) == before
    assert "sort" not in address_of(view)


def test_a_cell_shows_its_runs_and_escape_returns(view, records):
    cell = view.locator("#psnr tbody .behind").nth(1)
    cell.click()
    panel = view.locator("#runs")
    assert panel.locator("h2").inner_text() == "qnerf, chair"
    assert panel.locator(".content > details").count() == 3
    score = records.cells_of("chair", "qnerf")[0].scores["psnr"]
    assert f"PSNR {score:.2f}" in panel.locator("summary").first.inner_text()
    assert FORMULA in panel.inner_text()
    assert "records/cells/chair.qnerf.0.json" in panel.inner_text()
    view.go_back()
    assert panel.is_hidden()
    view.go_forward()
    assert panel.is_visible()
    cell.click()
    view.keyboard.press("Escape")
    assert panel.is_hidden()
    assert cell.evaluate("node => node === document.activeElement")


def test_the_panel_covers_nothing_and_the_clicked_cell_stays_visible(view):
    cell = view.locator("#psnr tbody .behind").nth(2)
    right = """Math.max(...[...document.querySelectorAll('main section > *')]
        .map(node => node.getBoundingClientRect().right))"""
    for width in (965, 1340, 1400):  # about the breakpoints of the style
        view.set_viewport_size({"width": width, "height": 800})
        view.evaluate("scrollTo(0, 0)")
        cell.click()
        assert view.evaluate("document.documentElement.scrollWidth") <= width
        assert view.evaluate(right) <= view.locator("#runs").bounding_box()["x"] + 1
        row = cell.locator("xpath=ancestor::tr").bounding_box()
        assert -row["height"] < row["y"] < 800, "the clicked row is visible"
        view.keyboard.press("Escape")


def test_a_point_leads_to_everything_behind_it(browser, records, address):
    point = "scene=chair&method=qnerf&seed=1&step=400&runs.open=1"
    view, _ = opened(browser, f"{address}#{point}", viewport={"width": 1400, "height": 900})
    panel = view.locator("#runs")
    drawn = panel.locator("svg[role=img]").evaluate_all("all => all.map((node) => node.getAttribute('aria-label'))")
    assert [words.split(":")[0] for words in drawn[:3]] == ["loss", "gradient norm", "learning rate"]
    assert drawn[1] == "gradient norm: 0.3 → 0.05"
    panel.get_by_text("gradient by layer", exact=True).click()
    assert panel.get_by_text("density_net.1", exact=True).is_visible()
    (cell,) = [cell for cell in records.cells_of("chair", "qnerf") if cell.seed == 1]
    worst = panel.locator("table", has_text="The worst test views").locator("tbody th").all_inner_texts()
    assert worst == [score.view for score in sorted(cell.views, key=lambda score: score.psnr)][:3]
    assert "--scenes chair --methods qnerf --seeds 1 --first-seed 1 --device cpu --threads 1" in panel.inner_text()
    panel.get_by_role("button", name="density at step 400").click()
    assert "density.step=400" in address_of(view)
    assert view.locator("#amplifier output").inner_text() == "step 400"
    view.context.close()


@pytest.mark.parametrize("budget", ["steps", "seconds"])
def test_the_pairs_of_a_difference_are_those_that_were_compared(view, records, budget):
    pair = "qnerf", "nerf"
    view.evaluate(
        "choice => location.hash = new URLSearchParams(choice)",
        {"scene": "chair", "method": pair[0], "runs.against": pair[1], "runs.metric": "psnr", "runs.budget": budget,
         "runs.open": "1"},
    )  # fmt: skip
    panel = view.locator("#runs")
    panel.locator("table").first.wait_for()
    cells = {(cell.method, cell.seed): cell for cell in records.cells if cell.scene == "chair"}
    for seed in range(3):
        ours, theirs = scores_at(cells[pair[0], seed], cells[pair[1], seed], "psnr", budget)
        said = panel.locator("table").first.locator("tbody tr").nth(seed).locator("td").all_inner_texts()
        assert said == [str(seed), f"{ours:.3f}", f"{theirs:.3f}", f"{ours - theirs:+.3f}".replace("-", "−")]


def test_a_figure_is_saved_with_the_numbers_of_the_records(view, records):
    unfold(view)
    figure = view.locator("#convergence figure", has=view.locator("figcaption", has_text="chair")).first
    rows = rows_of(saved(view, figure, "CSV"))
    for cell in records.cells_of("chair", "qnerf"):
        own = [row for row in rows if (row["method"], row["seed"]) == ("qnerf", str(cell.seed))]
        assert [(int(row["step"]), float(row["test PSNR (dB)"])) for row in own] == [
            (point.step, pytest.approx(point.psnr, rel=1e-5)) for point in cell.curve
        ]


def test_points_lie_where_they_are_drawn(view):
    """The script computes the same places as Matplotlib's dots."""
    drawn, computed = view.evaluate(
        """() => {
            const figure = document.querySelector('#psnr .plots figure');
            const uses = [...figure.querySelectorAll('use')].map(use => [use.x.baseVal.value, use.y.baseVal.value]);
            const svg = figure.querySelector('svg');
            svg.dispatchEvent(new PointerEvent('pointermove', {clientX: 0, clientY: 0}));
            const dots = figure.points.filter(point => point.trace.kind === 'dots').map(point => point.at);
            return [uses, dots];
        }"""
    )
    assert len(computed) == 3
    for x, y in computed:
        assert min(abs(x - a) + abs(y - b) for a, b in drawn) < 0.05


def test_density_moves_with_the_checkpoint_and_the_address_keeps_it(view, records):
    unfold(view)
    player = view.locator(".density")
    assert player.locator("output").inner_text() == "step 1\u202f600"
    assert player.locator("figure:visible").count() == 3
    assert "3\u202f277 of 32\u202f768 points (10.0\u202f%) lie inside" in player.locator(".note").inner_text()
    path = player.locator("path").nth(1)
    last = path.get_attribute("d")
    player.locator("input[type=range]").focus()
    view.keyboard.press("Home")
    assert player.locator("output").inner_text() == "step 50"
    assert path.get_attribute("d") != last
    assert "density.step=50" in address_of(view)
    view.reload()
    assert player.locator("output").inner_text() == "step 50"


def test_the_page_is_complete_without_script(browser, address):
    page = browser.new_context(java_script_enabled=False).new_page()
    page.goto(address)
    assert page.locator("#psnr table").first.is_visible()
    page.locator("#amplifier summary").first.click()
    assert page.locator("#amplifier svg.plot").first.is_visible()
    assert page.locator(".save").count() == 0
    page.context.close()


@pytest.mark.parametrize(("width", "height"), [(1280, 900), (390, 844)])
@pytest.mark.parametrize("page", ["address", "lengthy"])
def test_the_most_important_is_visible_and_a_long_name_makes_no_page_wider_and_is_not_cut(
    browser, request, page, width, height
):
    view, _ = opened(browser, request.getfixturevalue(page), viewport={"width": width, "height": height})
    bottoms = "query => [...document.querySelectorAll(query)].map(node => node.getBoundingClientRect().bottom)"
    ends = view.evaluate(bottoms, ".question, h1, .exhibit img, .ruler svg")
    pictures = 4 if page == "lengthy" else 0  # the other run kept none
    assert len(ends) == 2 + pictures + 1, "question, answer, truth, baseline, contender, difference, and one ruler"
    assert max(ends[:-1]) < height
    assert width < 900 or max([*ends, *view.evaluate(bottoms, ".in-short > div")]) < height
    assert view.locator(".in-short > div").count() == 4, "confidence, scale, stability, and what was not tested"
    assert "serving" not in view.locator("header").inner_text().split("At what scale")[0]
    if width < 900:
        right = view.evaluate("document.querySelector('#psnr th[data-method=qnerf]').getBoundingClientRect().right")
        assert right <= width, "the contender's scores are visible without scrolling"
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


def test_a_link_leads_to_its_section_and_unfolds_it(browser, view, address):
    for link in (".in-short a", 'nav a[href="#not-tested"]'):
        view.evaluate("scrollTo(0, 0)")
        view.locator(link).click()
        assert address_of(view).endswith("not-tested")
        top = view.evaluate("document.getElementById('not-tested').getBoundingClientRect().top")
        assert 0 <= top < 900
    assert not view.evaluate("document.querySelector('#metrics > details').open")
    view.locator('nav a[href="#metrics"]').click()
    assert view.evaluate("document.querySelector('#metrics > details').open")
    view.locator("#metrics > details > summary").click()
    view.wait_for_timeout(100)
    assert not view.evaluate("document.querySelector('#metrics > details').open"), "it can be folded again"
    other, _ = opened(browser, f"{address}#provenance")
    assert other.evaluate("document.querySelector('#provenance > details').open")
    assert not other.evaluate("document.querySelector('#metrics > details').open")
    other.context.close()


LANDED = """id => {
    const target = document.getElementById(id);
    const heading = target.matches('header') ? target : target.querySelector('h2, h3, summary') ?? target;
    return {top: heading.getBoundingClientRect().top, seen: heading.checkVisibility()};
}"""
IDS = """() => [...document.querySelectorAll('header, main [id]')]
    .filter(node => !node.closest('svg, script, #comparer, table') && !node.matches('script'))
    .map(node => node.id).filter(Boolean)"""


@pytest.mark.parametrize("page", ["address", "stability"])
def test_every_link_lands_with_its_heading_at_the_top(browser, request, tmp_path, page):
    if page == "stability":
        address = write_study_page(shelf_shown(fake_studies("stability")), tmp_path).as_uri()
    else:
        address = request.getfixturevalue(page)
    view, _ = opened(browser, address, viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    ids = view.evaluate(IDS)
    assert len(ids) >= 15
    astray = []
    for name in ids:
        view.evaluate(
            """name => {
            for (const details of document.querySelectorAll('main details')) details.open = false;
            scrollTo(0, 0); history.replaceState(null, '', location.pathname); location.hash = name; }""",
            name,
        )
        view.wait_for_timeout(60)
        landed = view.evaluate(LANDED, name)
        if not (landed["seen"] and -1 <= landed["top"] <= 80):
            astray.append((name, landed))
    assert astray == []
    for name in (ids[0], ids[len(ids) // 2], ids[-1]):
        other, _ = opened(view.context.browser, f"{address}#{name}", viewport={"width": 1280, "height": 900})
        other.wait_for_timeout(100)
        assert -1 <= other.evaluate(LANDED, name)["top"] <= 80, (name, "opened with the page")
        other.context.close()
    view.context.close()


def test_a_chart_is_enlarged_and_its_lines_are_hidden_by_pointer_and_keys(view):
    figure = view.locator("#convergence figure").first
    figure.scroll_into_view_if_needed()
    svg, ends = figure.locator("svg.plot"), "figure => [figure.chart.x.low, figure.chart.x.high, figure.points.length]"
    before = svg.inner_html()
    svg.focus()
    view.keyboard.press("ArrowRight")
    low, high, many = figure.evaluate(ends)
    view.keyboard.press("+")
    smaller = figure.evaluate(ends)
    assert low <= smaller[0] + 1e-9 < smaller[1] <= high
    assert smaller[1] / smaller[0] < high / low
    assert smaller[2] < many
    view.keyboard.press("0")
    assert figure.evaluate(ends) == [low, high, many]
    assert svg.inner_html() == before, "the complete drawing is there again"
    box = svg.bounding_box()
    view.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.2 * box["height"])
    view.mouse.down()
    view.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 0.6 * box["height"], steps=3)
    view.mouse.up()
    assert figure.evaluate(ends)[1] < high
    assert view.locator("#runs").is_hidden(), "a drag is no click"
    inside = "figure => figure.points.every(({at: [x]}) => x > figure.chart.box[0] - 1)"
    assert figure.evaluate(inside)
    figure.get_by_role("button", name="show all").click()
    assert svg.inner_html() == before
    entry = view.locator("#convergence .legend button", has_text="qnerf")
    entry.focus()
    view.keyboard.press("Enter")
    assert entry.get_attribute("aria-pressed") == "false"
    shown = "[...document.querySelectorAll('#convergence figure:first-of-type [data-line]')]"
    names = f"{shown}.filter(line => line.style.display !== 'none').map(line => line.dataset.line)"
    assert not any(name.startswith("qnerf") for name in view.evaluate(names))
    assert any(name.startswith("nerf") for name in view.evaluate(names))
    assert not any(name.startswith("qnerf") for name in figure.evaluate("f => f.points.map(p => p.trace.label)"))
    entry.click()
    assert svg.inner_html() == before


def test_the_open_page_of_an_unfinished_run_says_that_there_is_a_newer_one(browser, tmp_path):
    records = read_records(write_fake_run(tmp_path / "run", ("chair",), seeds=2, with_diverged=False))
    begun = replace(records, run=replace(records.run, finished=False), cells=records.cells[:-1])
    view = browser.new_context().new_page()
    errors: list[str] = []
    view.on("pageerror", lambda error: errors.append(str(error)))
    view.on("console", lambda message: errors.append(message.text))
    view.clock.install()
    view.goto(written(begun))
    bar = view.locator(".newer")
    view.clock.run_for(6000)
    view.wait_for_timeout(200)
    assert bar.inner_text() == ""
    address = written(records)
    view.clock.run_for(6000)
    until(view, "document.querySelector('.newer').textContent.includes('newer report')")
    view.get_by_role("button", name="Reload").click()
    until(view, "!document.querySelector('.newer')")
    assert (view.url, errors) == (address, [])
    view.context.close()


@pytest.mark.thorough
def test_eight_scenes_take_at_most_fifteen_screens_and_15_megabytes(browser, tmp_path):
    records = read_records(write_fake_run(tmp_path / "run", EIGHT, size=128))
    view, _ = opened(browser, written(records), viewport={"width": 1280, "height": 900})
    assert view.evaluate("document.documentElement.scrollHeight") <= 15 * 900
    assert (records.out / "report.html").stat().st_size < 15_000_000
    view.context.close()


def test_the_reader_chooses_the_visible_pair_of_error_and_cost(view):
    seen = "[...document.querySelectorAll('.choice')].filter(node => node.offsetHeight).map(node => node.className)"
    assert view.evaluate(seen) == ["choice rmse_linear-seconds"]
    for words in ("1 − SSIM", "network evaluations"):
        view.get_by_text(words, exact=True).first.click()
    assert view.evaluate(seen) == ["choice ssim-evaluations"]
    view.keyboard.press("ArrowLeft")
    assert view.evaluate(seen) == ["choice ssim-core_seconds"], "by keyboard as well"


def test_a_forest_is_saved_as_it_is_drawn_with_its_numbers(view):
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
    address = write_study_page(shelf_shown(fake_studies("stability")), tmp_path).as_uri()
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
