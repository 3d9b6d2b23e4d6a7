"""How the picture comparer is moved about in a real browser: modes, keys, zoom, checkpoints, and its address."""

import pytest

from tests.reports.browsing import address_of, until
from tests.reports.comparer_page import Packed, ball, data_of, rendered, write_comparer_page
from tests.reports.comparer_view import SIDE, asked, bytes_of, ready, settle, shown

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    packed = Packed()
    path = tmp_path_factory.mktemp("comparer") / "page.html"
    return write_comparer_page(path, data_of(packed, SIDE), packed).as_uri()


def test_wipe_by_mouse_and_by_keys(browser, address):
    view, noise = ready(browser, address, "at=pictures&compare.mode=wipe&compare.a=nerf&compare.b=qnerf")
    truth = ball(SIDE, SIDE, 0)
    left, right = (bytes_of(rendered(truth, number, 0, 1600)["display"], 20, 30) for number in (0, 2))
    assert left != right
    assert shown(view, "wipe-colour", 20, 30) == left
    handle = view.get_by_role("slider", name="Where A ends")
    frame = view.locator(".frame").bounding_box()
    view.mouse.move(frame["x"] + frame["width"] / 2, frame["y"] + 60)
    view.mouse.down()
    view.mouse.move(frame["x"] + frame["width"] * 0.25, frame["y"] + 60, steps=4)
    view.mouse.up()
    settle(view)
    assert abs(int(handle.get_attribute("aria-valuenow")) - 25) <= 1
    assert shown(view, "wipe-colour", 20, 30) == right
    handle.focus()
    for _ in range(3):
        view.keyboard.press("Shift+ArrowRight")
    settle(view)
    assert abs(int(handle.get_attribute("aria-valuenow")) - 55) <= 1
    assert shown(view, "wipe-colour", 20, 30) == left
    until(view, "location.hash.includes('compare.wipe=')")
    assert noise == []


def test_keys_flip_and_pick_pictures_in_place(browser, address):
    view, noise = ready(browser, address, "at=pictures&compare.a=nerf")
    view.locator(".stage").focus()
    truth = ball(SIDE, SIDE, 0)
    pixel = {n: bytes_of(rendered(truth, n, 0, 1600)["display"], 11, 25) for n in range(3)}
    seen = []
    for key in ("f", "f", "f", "3", "Shift+2", "1"):
        view.keyboard.press(key)
        settle(view)
        seen.append((view.inner_text("figcaption .who"), shown(view, "flip-colour", 11, 25)))
    assert seen == [
        ("nerf", pixel[0]),
        ("qnerf", pixel[2]),
        ("nerf", pixel[0]),
        ("nerf_matched", pixel[1]),
        ("nerf_matched", pixel[1]),
        ("ground truth", bytes_of(truth["display"], 11, 25)),
    ]
    assert asked(view, "compare.a") == "truth"
    view.keyboard.press("s")
    settle(view)
    assert view.locator(".pane").count() == 4
    assert noise == []


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


def test_the_pixel_and_the_view_move_by_keys_and_are_told(browser, address):
    view, _ = ready(browser, address, "at=pictures&compare.zoom=4&compare.pixel=20,20")
    view.locator(".stage").focus()
    for _ in range(2):
        view.keyboard.press("Control+ArrowRight")
    view.keyboard.press("ArrowDown")
    settle(view)
    assert view.inner_text(".probe thead th:first-child") == "pixel 40, 21"
    assert view.inner_text("[aria-live]").startswith("Pixel 40, 21: ground truth ")
    until(view, "location.hash.includes('compare.pixel=40%2C21')")
    before = float(asked(view, "compare.x"))
    assert before > 0.5
    view.keyboard.press("Shift+ArrowLeft")
    until(view, f"+new URLSearchParams(location.hash.slice(1)).get('compare.x') < {before}")
    assert view.inner_text(".probe thead th:first-child") == "pixel 40, 21"


def test_an_address_restores_everything(browser, address):
    view, _ = ready(browser, address)
    view.get_by_role("combobox", name="Scene").select_option("mic")
    view.get_by_role("combobox", name="View").select_option("r_12")
    view.get_by_role("button", name="Difference").click()
    view.get_by_role("combobox", name="A", exact=True).select_option("qnerf")
    view.get_by_role("combobox", name="B", exact=True).select_option("nerf")
    view.get_by_role("button", name="FLIP", exact=True).click(modifiers=["Shift"])
    view.get_by_role("combobox", name="Channel").select_option("green")
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
