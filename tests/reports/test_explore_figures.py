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


def test_the_page_is_whole_without_script(browser, explored):
    page = browser.new_context(java_script_enabled=False).new_page()
    page.goto(explored[1])
    assert page.locator("#psnr table").first.is_visible()
    assert page.locator("#amplifier svg.plot").first.is_visible()
    assert page.locator(".save").count() == 0
    page.context.close()
