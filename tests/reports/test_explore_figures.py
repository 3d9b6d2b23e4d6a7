"""Figures, density, keys, dark and paper, in a real browser."""

import xml.etree.ElementTree as ET

import pytest

from tests.reports.browsing import address_of, opened
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


def test_the_page_is_whole_without_script(browser, explored):
    page = browser.new_context(java_script_enabled=False).new_page()
    page.goto(explored[1])
    assert page.locator("#psnr table").first.is_visible()
    assert page.locator("#amplifier svg.plot").first.is_visible()
    assert page.locator(".save").count() == 0
    page.context.close()
