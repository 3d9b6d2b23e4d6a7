"""The page in a real browser: no errors, no requests, readable in the dark and on a phone."""

import shutil
from collections.abc import Iterator
from typing import Any

import pytest

from reports.load import read_records
from reports.page import write_page

playwright = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium found (Debian: apt-get install chromium)"),
    pytest.mark.slow,
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture(scope="module")
def address(pictured, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_page(read_records(pictured), path)
    return path.as_uri()


def opened(browser: Any, address: str, **context: Any) -> tuple[Any, list[str]]:
    """The page and whatever it complained of or asked for."""
    view = browser.new_context(**context).new_page()
    noise: list[str] = []
    view.on("console", lambda message: noise.append(f"console: {message.text}"))
    view.on("pageerror", lambda error: noise.append(f"error: {error}"))
    view.on(
        "request",
        lambda request: noise.append(request.url) if request.url != address and request.url[:5] != "data:" else None,
    )
    view.goto(address)
    return view, noise


def test_no_errors_and_no_requests(browser, address):
    view, noise = opened(browser, address)
    view.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    assert noise == []
    broken = "[...document.images].filter(one => !one.complete || one.naturalWidth === 0).length"
    assert view.evaluate(broken) == 0


def test_the_first_screen_tells_the_result(browser, address):
    view, _ = opened(browser, address, viewport={"width": 1300, "height": 1000})
    assert view.inner_text("h1") == "qnerf lost 1 of its 6 cells: against nerf nothing is settled"
    for words in ("at equal training time", "against nerf_matched", "this run", "did not finish"):
        box = view.get_by_text(words).first.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] < 1000, words


@pytest.mark.parametrize("width", [360, 768, 1300])
def test_the_page_is_never_wider_than_its_window(browser, address, width):
    view, _ = opened(browser, address, viewport={"width": width, "height": 800})
    assert view.evaluate("document.documentElement.scrollWidth") == width


def test_plots_have_a_size_and_a_description(browser, address):
    view, _ = opened(browser, address)
    sizes = view.evaluate(
        "[...document.querySelectorAll('main section > .plots svg')].map(one => one.getBoundingClientRect().height)"
    )
    assert len(sizes) > 10
    assert min(sizes) > 80
    assert view.evaluate("[...document.querySelectorAll('svg, img')].every(o => o.ariaLabel || o.alt)")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_stands_out_from_its_ground(browser, address, scheme):
    view, _ = opened(browser, address, color_scheme=scheme)
    weakest = view.evaluate(
        """() => {
        const number = text => text.match(/[\\d.]+/g).slice(0, 3).map(Number);
        const light = rgb => rgb.map(v => v / 255).map(v => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
            .reduce((sum, v, i) => sum + v * [.2126, .7152, .0722][i], 0);
        const ground = light(number(getComputedStyle(document.body).backgroundColor));
        const texts = [...document.querySelectorAll('h1 b, p b, td, th, small, .note, nav a, summary, .plot text')];
        return Math.min(...texts.filter(one => one.textContent.trim()).map(one => {
            const style = getComputedStyle(one);
            const ink = light(number(one.closest('svg') ? style.fill : style.color));
            return (Math.max(ink, ground) + .05) / (Math.min(ink, ground) + .05);
        }));
    }"""
    )
    assert weakest >= 4.5
