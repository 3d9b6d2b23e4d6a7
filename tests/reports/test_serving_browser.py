"""What serving was measured to do in a real browser: chosen without a script, readable in the dark and on a phone."""

import pytest

from reports.beside import Beside
from reports.load import read_records
from reports.page import write_page
from tests.reports.browsing import opened, unfold, weakest_contrast
from tests.reports.fake_run import write_fake_run
from tests.reports.fake_serving import fake_serving, write_fake_serving

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
