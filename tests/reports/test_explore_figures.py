"""Figures, density, keys, dark and paper, in a real browser."""

import xml.etree.ElementTree as ET

import pytest

from tests.reports.browsing import address_of, opened, unseen_buttons, weakest_contrast
from tests.reports.exploring import rows_of, saved, write_exploring

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def explored(tmp_path_factory):
    return write_exploring(tmp_path_factory.mktemp("explored"))


@pytest.fixture(scope="module")
def records(explored):
    return explored[0]


@pytest.fixture
def view(browser, explored):
    page, noise = opened(browser, explored[1], viewport={"width": 1300, "height": 900}, reduced_motion="reduce")
    page.set_default_timeout(8000)
    yield page
    assert [one for one in noise if not one.startswith("blob:")] == []
    page.context.close()


def figure(view, section, title):
    return view.locator(f"#{section} figure", has=view.locator("figcaption", has_text=title)).first


def test_every_drawing_can_be_saved_and_reached_by_keys(view):
    drawings = view.locator("figure:has(script.drawn)").count()
    assert drawings > 20
    assert view.locator("figure:has(script.drawn) .save").count() == drawings
    assert view.locator("figure:has(script.drawn) svg.plot[tabindex='0']").count() == drawings


def test_a_figure_is_saved_with_the_numbers_of_the_records(view, records):
    rows = rows_of(saved(view, figure(view, "convergence", "chair"), "CSV"))
    for cell in records.cells_of("chair", "qnerf"):
        own = [row for row in rows if (row["method"], row["seed"]) == ("qnerf", str(cell.seed))]
        assert [(int(row["step"]), float(row["test PSNR (dB)"])) for row in own] == [
            (point.step, pytest.approx(point.psnr, rel=1e-5)) for point in cell.curve
        ]


def test_a_saved_drawing_stands_alone(view):
    text = saved(view, figure(view, "convergence", "chair"), "SVG")
    tree = ET.fromstring(text)
    name = "{http://www.w3.org/2000/svg}"
    assert tree.tag == f"{name}svg"
    assert tree.find(f"{name}title").text == "chair"
    assert "var(" not in text
    assert "#c45000" in text
    assert "■ qnerf" in text


def test_points_lie_where_they_are_drawn(view):
    """The dots that Matplotlib drew and the places that the script computes from the numbers."""
    drawn, computed = view.evaluate(
        """() => {
            const figure = document.querySelector('#psnr .plots figure');
            const uses = [...figure.querySelectorAll('use')].map(one => [one.x.baseVal.value, one.y.baseVal.value]);
            const svg = figure.querySelector('svg');
            svg.dispatchEvent(new PointerEvent('pointermove', {clientX: 0, clientY: 0}));
            const dots = figure.points.filter(point => point.trace.kind === 'dots').map(point => point.at);
            return [uses, dots];
        }"""
    )
    assert len(computed) == 3
    for x, y in computed:
        assert min(abs(x - a) + abs(y - b) for a, b in drawn) < 0.05


def test_pointing_at_a_curve_says_what_it_is_and_a_click_opens_its_runs(view, records):
    one = figure(view, "convergence", "chair")
    plot = one.locator("svg.plot")
    plot.scroll_into_view_if_needed()
    place = plot.evaluate(
        """svg => {
            svg.dispatchEvent(new PointerEvent('pointermove', {clientX: 0, clientY: 0}));
            const points = svg.closest('figure').points;
            const [x, y] = points.find(({trace, index}) => trace.label === 'qnerf mean' && index === 5).at;
            const at = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
            return [at.x, at.y];
        }"""
    )
    view.mouse.move(*place)
    tip = view.locator(".tip").inner_text()
    assert "qnerf" in tip
    assert "1\u202f600" in tip
    view.mouse.click(*place)
    assert view.locator("#runs h2").inner_text() == "qnerf, chair"
    assert "step=1600" in address_of(view)
    assert view.locator("#runs tr.chosen").first.inner_text().startswith("1\u202f600")


def test_a_row_of_differences_opens_its_pairs_wherever_it_is_clicked(view):
    one = view.locator("#psnr .plots figure").first
    plot = one.locator("svg.plot")
    plot.scroll_into_view_if_needed()
    title = one.locator("figcaption").inner_text()
    place = plot.evaluate(
        """svg => {
            svg.dispatchEvent(new PointerEvent('pointermove', {clientX: 0, clientY: 0}));
            const {points, chart} = svg.closest('figure');
            const dots = points.filter(({trace}) => trace.kind === 'dots');
            const row = dots.find(({trace, index}) => chart.y.rows[trace.y[index]] === 'chair');
            const at = new DOMPoint(chart.box[0] - 12, row.at[1]).matrixTransform(svg.getScreenCTM());
            return [at.x, at.y];
        }"""
    )
    view.mouse.click(*place)
    assert view.locator("#runs h2").inner_text() == "qnerf − nerf, chair", "on its name, left of the axis"
    assert title.startswith("qnerf − nerf at equal steps")
    assert "runs.budget=steps" in address_of(view)


def test_what_the_paper_prints_is_not_said_to_have_runs_behind_it(view):
    plot = view.locator("#psnr .plots figure").first.locator("svg.plot")
    plot.scroll_into_view_if_needed()
    tips = []
    for kind in ("mark", "dots"):
        place = plot.evaluate(
            """(svg, kind) => {
                svg.dispatchEvent(new PointerEvent('pointermove', {clientX: 0, clientY: 0}));
                const [x, y] = svg.closest('figure').points.find(({trace}) => trace.kind === kind).at;
                const at = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
                return [at.x, at.y];
            }""",
            kind,
        )
        view.mouse.move(*place)
        tips.append(view.locator(".tip").inner_text())
    assert "printed in the paper" in tips[0]
    assert tips[0].endswith("click: the runs of what was measured here")
    assert tips[1].endswith("click: the runs behind it")


def test_a_figure_is_read_by_keys_alone(view):
    view.locator("#convergence svg.plot").nth(1).focus()
    for key in ("ArrowRight", "ArrowRight", "ArrowDown"):
        view.keyboard.press(key)
    first = view.locator(".tip").inner_text()
    assert "step: 100" in first
    view.keyboard.press("Enter")
    assert view.locator("#runs").is_visible()
    assert "step=100" in address_of(view)
    view.keyboard.press("Escape")
    assert view.locator("#runs").is_hidden()


def test_density_moves_with_the_checkpoint_and_the_address_keeps_it(view, records):
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


@pytest.mark.parametrize("which", [".density figure", "#amplifier figure:has(script.drawn)"])
def test_a_saved_histogram_holds_what_was_measured(view, records, which):
    rows = rows_of(saved(view, view.locator(which).first, "CSV"))
    last = [cell.curve[-1].density for cell in records.cells_of("chair", "qnerf")]
    for side in ("before", "after"):
        own = [row for row in rows if row["series"] == f"{side} the amplifier"]
        assert [float(row["from"]) for row in own] == pytest.approx(last[0]["edges"][:-1], rel=1e-5)
        assert [float(row["to"]) for row in own] == pytest.approx(last[0]["edges"][1:], rel=1e-5)
        shares = [float(row["share of points"]) for row in own]
        assert shares == pytest.approx(last[0][side], rel=1e-5), "the same in all seeds"
        assert sum(shares) == pytest.approx(1, abs=1e-5)
    assert shares.count(0) == last[0]["after"].count(0) > 10


@pytest.mark.parametrize("which", [".density figure", "#amplifier figure:has(script.drawn)"])
def test_an_empty_bin_says_so_and_lies_on_the_axis(view, which):
    plot = view.locator(which).first.locator("svg.plot")
    plot.focus()
    for key in ("ArrowRight", "ArrowDown", "End"):
        view.keyboard.press(key)
    assert view.locator(".tip").inner_text().splitlines()[:3] == [
        "after the amplifier",
        "share of points: 0",
        "density σ: 79.43 to 100",
    ]
    foot = plot.evaluate("svg => { const [, top, , high] = svg.closest('figure').chart.box; return top + high; }")
    assert float(view.locator(".ring").get_attribute("cy")) == pytest.approx(foot)


def test_density_plays_to_its_end(view):
    player = view.locator(".density")
    player.locator("input[type=range]").focus()
    for key in ("End", "ArrowLeft"):
        view.keyboard.press(key)
    player.get_by_role("button", name="play").click()
    assert player.locator("output").inner_text() == "step 800"
    player.locator("output", has_text="step 1\u202f600").wait_for()
    player.get_by_role("button", name="play").wait_for()


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_theme_is_the_readers_whatever_the_system_has(browser, explored, theme):
    other = "light" if theme == "dark" else "dark"
    page, _ = opened(browser, f"{explored[1]}#theme={theme}", color_scheme=other)
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground == {"light": "rgb(254, 254, 254)", "dark": "rgb(21, 21, 23)"}[theme]
    page.locator("#psnr .behind").first.click()
    ratio, text = weakest_contrast(page, ".panel p, .panel dt, .panel dd, .panel td, .panel summary span, .tool, .sort")
    assert ratio >= 4.5, text
    page.emulate_media(media="print")
    assert page.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--paper').trim()") == "#fefefe"
    page.context.close()


def test_keys_turn_the_page_and_say_what_they_are(view):
    view.keyboard.press("t")
    assert "theme=light" in address_of(view)
    view.keyboard.press("n")
    assert "at=psnr" in address_of(view)
    view.keyboard.press("n")
    assert "at=convergence" in address_of(view)
    view.keyboard.press("p")
    assert "at=psnr" in address_of(view)
    view.keyboard.press("?")
    assert view.locator("dialog.keys").is_visible()
    view.keyboard.press("Escape")
    assert view.locator("dialog.keys").is_hidden()


def test_the_contents_keep_what_is_chosen(view):
    view.locator("#metrics th .sort").nth(2).click()
    view.locator("nav a", has_text="PSNR").click()
    assert "at=psnr" in address_of(view)
    assert "table.metrics-0.sort" in address_of(view)


def test_paper_has_everything_unfolded_and_no_controls(view):
    view.evaluate("dispatchEvent(new Event('beforeprint'))")
    view.emulate_media(media="print")
    assert view.locator("details:not([open])").count() == 0
    for selector in (".tools:visible", ".save:visible", ".bar:visible", ".choose:visible"):
        assert view.locator(selector).count() == 0, selector
    view.emulate_media(media="screen")
    view.evaluate("dispatchEvent(new Event('afterprint'))")
    assert view.locator("#comparisons details[open]").count() == 0


def test_a_phone_holds_the_page_and_its_panel(browser, explored):
    page, noise = opened(browser, explored[1], viewport={"width": 390, "height": 844})
    page.locator("#psnr .behind").first.click()
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert page.locator("#claims thead .sort").count() > 0
    assert unseen_buttons(page) == []
    box = page.locator("#runs").bounding_box()
    assert box["x"] == 0
    assert box["width"] == 390
    assert box["height"] <= 0.73 * 844
    assert noise == []
    page.context.close()


def test_the_page_is_whole_without_script(browser, explored):
    page = browser.new_context(java_script_enabled=False).new_page()
    page.goto(explored[1])
    assert page.locator("#psnr table").first.is_visible()
    assert page.locator("#amplifier svg.plot").first.is_visible()
    assert page.locator(".save").count() == 0
    page.context.close()
