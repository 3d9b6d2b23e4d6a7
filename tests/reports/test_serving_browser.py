"""What serving was measured to do in a real browser: chosen without a script, readable in the dark and on a phone."""

import pytest

from reports.beside import Beside
from reports.load import read_records
from reports.page import write_page
from tests.reports.browsing import opened, unfold, unseen_buttons, weakest_contrast
from tests.reports.exploring import rows_of, saved
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_serving import fake_serving, write_fake_serving
from tests.reports.menus import saveable

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    out = write_fake_run(tmp_path_factory.mktemp("serving") / "run", ("chair",), pictures=False)
    write_fake_serving(out)
    write_page(read_records(out), out / "report.html", Beside(serving=fake_serving()))
    return (out / "report.html").as_uri()


def shown(view) -> list[str]:
    return view.evaluate(
        "[...document.querySelectorAll('.measured')].filter(one => one.offsetHeight).map(one => one.className)"
    )


def test_one_map_of_attention_is_seen_and_the_reader_chooses_which(browser, address):
    view, noise = opened(browser, address)
    assert shown(view) == ["measured map0-served0"]
    view.get_by_text("gradients of the coarse frame", exact=True).first.click()
    assert shown(view) == ["measured map1-served0"]
    view.keyboard.press("ArrowLeft")
    assert shown(view) == ["measured map0-served0"], "by keyboard as well"
    assert noise == []


@pytest.mark.parametrize("width", [360, 768, 1300])
def test_the_page_is_never_wider_than_its_window(browser, address, width):
    view, _ = opened(browser, address, viewport={"width": width, "height": 800})
    unfold(view)
    assert view.evaluate("document.documentElement.scrollWidth") == width
    assert unseen_buttons(view) == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(browser, address, scheme):
    view, _ = opened(browser, address, color_scheme=scheme)
    unfold(view)
    of = ("td", "th", "p", "li", "figcaption", "label", "h4", ".plot text")
    ratio, text = weakest_contrast(view, ", ".join(f"#{name} {one}" for name in ("cache", "attention") for one in of))
    assert ratio >= 4.5, text


def test_bars_fill_their_track_and_neighbours_differ(browser, address):
    view, _ = opened(browser, address)
    apart = """[...document.querySelectorAll('.stack')].map(one => {
        const parts = [...one.children].map(part => part.getBoundingClientRect());
        const colours = [...one.children].map(part => getComputedStyle(part).backgroundColor);
        return [parts.at(-1).right - parts[0].left - one.getBoundingClientRect().width,
                new Set(colours).size - colours.length];
    })"""
    for gap, same in view.evaluate(apart):
        assert abs(gap) < 1.5
        assert same == 0


def test_pictures_are_shown(browser, address):
    view, _ = opened(browser, address)
    assert view.evaluate("[...document.querySelectorAll('.strip img')].map(one => one.naturalWidth)") == [40, 40, 40]


def test_all_that_is_shown_can_be_saved(browser, address):
    view, _ = opened(browser, address)
    many = saveable(view)
    assert {kind for kind in many if many[kind]} == {"table", "drawn table", "chart", "picture"}


def test_bars_of_camera_paths_are_as_wide_as_their_column_on_paper_too(browser, address):
    view, _ = opened(browser, address)
    narrow = """[...document.querySelectorAll('.uses .stack')].filter(one =>
        one.getBoundingClientRect().width < 0.8 * one.closest('td').getBoundingClientRect().width).length"""
    assert view.locator(".uses .stack").count() == 2
    assert view.evaluate(narrow) == 0
    view.emulate_media(media="print")
    assert view.locator(".uses .stack").first.is_visible()
    assert view.evaluate(narrow) == 0


def test_a_drawing_of_camera_paths_is_saved_with_the_rows_in_sight_alone(browser, address):
    view, noise = opened(browser, address)
    tools = view.locator("#cache .tools", has=view.get_by_role("button", name="Save the figure: Where the views"))
    names = view.locator(".uses tbody th").evaluate_all("all => all.map(one => one.firstChild.textContent.trim())")
    assert len(set(names)) == 2
    for left in (2, 1, 0):
        view.evaluate(
            """left => [...document.querySelector('.uses').tBodies[0].rows]
                .forEach((row, place) => row.classList.toggle('unmatched', place >= left))""",
            left,
        )
        drawing = saved(view, tools, "SVG")
        assert [name for name in names if f">{name}</text>" in drawing] == names[:left]
        assert len(rows_of(saved(view, tools, "CSV"))) == left
    assert [one for one in noise if not one.startswith("blob:")] == []
