"""How the picture comparer is moved about in a real browser: modes, keys, zoom, checkpoints, and its address."""

import pytest

from tests.reports.browsing import address_of, until
from tests.reports.comparer_page import Packed, ball, data_of, rendered, write_comparer_page
from tests.reports.comparer_view import SIDE, asked, bytes_of, ready, settle

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    packed = Packed()
    path = tmp_path_factory.mktemp("comparer") / "page.html"
    return write_comparer_page(path, data_of(packed, SIDE), packed).as_uri()


def test_zoom_and_pan_are_locked_over_all_panels(browser, address):
    view, _ = ready(browser, address, "at=pictures&compare.map=colour+delta_e")
    boxes = [one.bounding_box() for one in view.locator(".stage canvas").all()]
    assert len(boxes) == 8
    view.mouse.click(boxes[0]["x"] + 50, boxes[0]["y"] + 60)
    view.mouse.wheel(0, -600)
    settle(view)
    view.mouse.down()
    view.mouse.move(boxes[0]["x"] + 90, boxes[0]["y"] + 95, steps=4)
    view.mouse.up()
    settle(view)
    until(view, "location.hash.includes('compare.zoom=')")
    times, width = 2**2.5, boxes[0]["width"]
    assert float(asked(view, "compare.zoom")) == pytest.approx(times, abs=0.001)
    # What was clicked stays under the wheel and goes along with the drag, so that it is now 90 from the left.
    assert float(asked(view, "compare.x")) == pytest.approx(50 / width + (width / 2 - 90) / (width * times), abs=1e-3)
    assert not view.evaluate("document.querySelector('.probe').scrollLeft")
    pixels = []
    for box in (view_box.bounding_box() for view_box in view.locator(".stage canvas").all()):
        view.mouse.move(box["x"] + 90, box["y"] + 95)
        settle(view)
        pixels.append(view.inner_text(".probe thead th:first-child"))
    assert len(set(pixels)) == 1
    assert pixels[0] != "pixel 19, 20"
    column, row = map(int, pixels[0].removeprefix("pixel ").split(","))
    # The pixel that was clicked at 50, 60 and the one that the drag brought to 90, 95 are the same.
    assert asked(view, "compare.pixel") == f"{column},{row}"
    under = """([x, y]) => [...document.querySelectorAll('[data-panel$="-colour"] canvas')].map(one => {
        const point = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
        point.drawImage(one, -x, -y);
        return [...point.getImageData(0, 0, 1, 1).data].slice(0, 3).join(' ');
    })"""
    view.mouse.move(5, 5)
    view.keyboard.press("Escape")
    settle(view)
    drawn = view.evaluate(under, [90, 95])
    truth = ball(SIDE, SIDE, 0)
    expected = [truth["display"], *(rendered(truth, n, 0, 1600)["display"] for n in range(3))]
    assert drawn == [" ".join(map(str, bytes_of(one, column, row))) for one in expected]
    view.locator(".stage canvas").first.dblclick()
    settle(view)
    until(view, "!location.hash.includes('compare.zoom')")


def test_an_address_restores_everything(browser, address):
    view, _ = ready(browser, address)
    view.get_by_role("combobox", name="Scene").select_option("mic")
    view.get_by_role("combobox", name="View").select_option("r_12")
    view.get_by_role("button", name="Difference").click()
    view.get_by_role("combobox", name="A", exact=True).select_option("qnerf")
    view.get_by_role("combobox", name="B", exact=True).select_option("nerf")
    view.get_by_role("button", name="FLIP", exact=True).click(modifiers=["Shift"])
    view.locator(".stage canvas").first.click(position={"x": 100, "y": 90})
    for key in ("+", "+", "e", ","):
        view.keyboard.press(key)
        settle(view)
    until(view, "location.hash.includes('compare.zoom')")
    again, _ = ready(browser, *address_of(view).split("#"))
    pictures = "[...document.querySelectorAll('.stage canvas')].map(one => one.toDataURL())"
    for what in (
        pictures,
        "document.querySelector('.probe').innerText",
        "document.querySelector('.controls').innerText",
    ):
        assert again.evaluate(what) == view.evaluate(what)
    assert again.evaluate(pictures)[0] != again.evaluate(pictures)[1]
    assert again.inner_text(".probe thead").count("A against B") == 2
