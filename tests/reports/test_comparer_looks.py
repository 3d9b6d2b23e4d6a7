"""How the picture comparer looks and reads in a real browser: any width, light and dark, any name, by keys alone."""

import pytest

from tests.reports.browsing import until, weakest_contrast
from tests.reports.comparer_page import Packed, data_of, write_comparer_page
from tests.reports.comparer_view import ready, settle

pytestmark = pytest.mark.slow

HOSTILE = ("<img src=x onerror=alert(1)>", "</script><b>", "truth", "a" * 90)


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    packed = Packed()
    path = tmp_path_factory.mktemp("looks") / "page.html"
    return write_comparer_page(path, data_of(packed, 24), packed).as_uri()


@pytest.fixture(scope="module")
def hostile(tmp_path_factory) -> str:
    packed = Packed()
    path = tmp_path_factory.mktemp("hostile") / "page.html"
    data = data_of(packed, 12, ("<svg onload=alert(2)>", "__proto__ & Söhne"), HOSTILE)
    data["left_out"] = ["<script>alert(3)</script> was left out."]
    return write_comparer_page(path, data, packed).as_uri()


@pytest.mark.parametrize("width", [360, 1300])
def test_the_page_is_never_wider_than_its_window(browser, address, hostile, width):
    for page in (address, hostile):
        choice = "at=pictures&compare.map=colour+signed+depth_error&compare.pixel=3,4"
        view, _ = ready(browser, page, choice, viewport={"width": width, "height": 800})
        for key in ("s", "w", "f", "d"):
            view.locator(".stage").focus()
            view.keyboard.press(key)
            settle(view)
            assert view.evaluate("document.documentElement.scrollWidth") == width, key


def test_panels_are_of_one_size_and_lie_in_lines(browser, address):
    view, _ = ready(browser, address, "at=pictures&compare.map=colour+flip")
    boxes = [one.bounding_box() for one in view.locator(".stage canvas").all()]
    assert {(round(box["width"]), round(box["height"])) for box in boxes} == {(round(boxes[0]["width"]),) * 2}
    assert len({round(box["y"]) for box in boxes}) == 2
    assert len({round(box["x"]) for box in boxes}) == 4


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(browser, address, scheme):
    choice = "at=pictures&scene=mic&seed=1&step=3&compare.map=signed+flip&compare.pixel=3,4"
    view, _ = ready(browser, address, choice, color_scheme=scheme)
    texts = "figcaption span, label span, output, button:enabled, select:enabled, .said, .why, .maplegend span, td, th"
    ratio, text = weakest_contrast(view, f"#comparer :is({texts})")
    assert ratio >= 4.5, text


def test_names_are_text_and_never_markup(browser, hostile):
    view, noise = ready(browser, hostile, "at=pictures&compare.mode=wipe&compare.a=method+truth")
    assert view.locator("figcaption .who").all_inner_texts()[0] == "truth"
    view.locator(".stage").focus()
    view.keyboard.press("s")
    settle(view)
    assert view.locator("figcaption .who").all_inner_texts() == ["ground truth", *HOSTILE]
    assert view.locator("#comparer :is(img, svg, script, figcaption b)").count() == 0
    assert "<script>alert(3)</script> was left out." in view.inner_text(".notes")
    assert noise == []


def test_all_of_it_has_names_and_is_reached_by_keys(browser, address):
    view, noise = ready(browser, address, "at=pictures&compare.mode=wipe&compare.map=signed")
    nameless = """[...document.querySelectorAll('#comparer :is(button, select, input, canvas, [role])')]
        .filter(one => !(one.ariaLabel || one.labels?.length || one.textContent.trim() || one.role === 'status'))"""
    assert view.evaluate(f"{nameless}.map(one => one.outerHTML)") == []
    view.evaluate("document.activeElement.blur()")
    reached = []
    for _ in range(60):
        view.keyboard.press("Tab")
        reached.append(
            view.evaluate("""(() => {
            const one = document.activeElement, style = getComputedStyle(one);
            return [one.ariaLabel || one.textContent, style.outlineStyle !== 'none' && style.outlineWidth !== '0px'];
        })()""")
        )
        if reached[-1][0] == "Numbers of a pixel":
            break
    names = [name for name, _ in reached]
    for name in (
        "Scene",
        "Wipe",
        "A",
        "Signed error",
        "Checkpoint",
        "Exposure",
        "Range of colours",
        "Where A ends and B begins",
    ):
        assert name in names, name
    assert [name for name, seen in reached if not seen] == []
    view.keyboard.press("?")
    assert view.get_by_role("dialog").is_visible()
    view.keyboard.press("Escape")
    until(view, "!document.querySelector('dialog').open")
    assert noise == []


def test_two_fingers_zoom_and_a_tap_asks_for_a_pixel(browser, address):
    view, _ = ready(browser, address, viewport={"width": 390, "height": 800}, has_touch=True)
    canvas = view.locator(".stage canvas").first
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    canvas.tap(position={"x": box["width"] * 0.52, "y": box["height"] * 0.27})
    settle(view)
    assert view.inner_text(".probe thead th:first-child") == "pixel 12, 6"
    fingers = view.context.new_cdp_session(view)
    middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    for kind, apart in (("touchStart", 20), ("touchMove", 35), ("touchMove", 60), ("touchEnd", None)):
        places = [] if apart is None else [(middle[0] - apart, middle[1]), (middle[0] + apart, middle[1])]
        points = [{"x": x, "y": y, "id": place} for place, (x, y) in enumerate(places)]
        fingers.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    until(view, "Math.abs(new URLSearchParams(location.hash.slice(1)).get('compare.zoom') - 3) < 0.2")


def test_panels_are_printed_with_what_they_show(browser, address):
    view, _ = ready(browser, address, "at=pictures&scene=mic&compare.ev=-1.5")
    view.emulate_media(media="print")
    assert view.inner_text("#comparer .where") == "Mic, view r_5, seed 0, step 1600, exposure −1.5 EV"
    assert not view.locator(".controls").is_visible()
    assert view.locator(".stage canvas:visible").count() == 4


def test_a_page_without_pictures_shows_no_comparer(browser, tmp_path):
    from tests.reports.browsing import opened

    data = {"methods": [], "variables": {}, "scenes": [], "left_out": []}
    view, noise = opened(browser, write_comparer_page(tmp_path / "page.html", data, Packed()).as_uri())
    assert not view.locator("#comparer").is_visible()
    assert noise == []


def test_the_numbers_cover_nothing_before_a_pixel_is_chosen(browser, address):
    view, _ = ready(browser, address, viewport={"width": 360, "height": 640}, has_touch=True)
    place = "getComputedStyle(document.querySelector('.probe')).position"
    assert view.evaluate(place) == "static"
    view.locator(".stage canvas").first.tap(position={"x": 30, "y": 30})
    until(view, f"{place} === 'sticky'")
    view.locator(".stage").focus()
    view.keyboard.press("Escape")
    until(view, f"{place} === 'static'")
