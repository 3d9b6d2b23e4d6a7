"""A page in a real browser: its console messages and requests, the contrast of its text, and its saved files."""

import csv
import io
from pathlib import Path
from typing import Any

CONTRAST = """selector => {
    const parts = text => text.match(/[\\d.]+/g).map(Number);
    const light = rgb => rgb.slice(0, 3).map(v => v / 255)
        .map(v => v <= .04045 ? v / 12.92 : ((v + .055) / 1.055) ** 2.4)
        .reduce((sum, v, i) => sum + v * [.2126, .7152, .0722][i], 0);
    const ground = element => {
        for (let node = element; node; node = node.parentElement) {
            const colour = parts(getComputedStyle(node).backgroundColor);
            if (colour.length < 4 || colour[3] === 1) return light(colour);
        }
        return 1;
    };
    const texts = [...document.querySelectorAll(selector)].filter(element => element.textContent.trim());
    const contrasts = texts.map(element => {
        const style = getComputedStyle(element);
        const ink = light(parts(element.closest('svg') ? style.fill : style.color)), below = ground(element);
        return [(Math.max(ink, below) + .05) / (Math.min(ink, below) + .05), element.textContent.trim().slice(0, 40)];
    });
    return contrasts.sort((a, b) => a[0] - b[0])[0];
}"""
"""The smallest contrast (WCAG) of a text and its background, and that text, among what a selector chooses."""


def opened(browser: Any, address: str, **context: Any) -> tuple[Any, list[str]]:
    """Return the page, and the list of its console messages, errors and requests."""
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


def address_of(view: Any) -> str:
    """Return the current address of the page; `view.url` may be older."""
    return view.evaluate("location.href")


def until(view: Any, true: str, seconds: float = 5.0) -> None:
    """Wait for an expression. Playwright's own way evaluates text in the page, which its policy forbids."""
    for _ in range(round(seconds / 0.025)):
        if view.evaluate(true):
            return
        view.wait_for_timeout(25)
    raise AssertionError(f"not within {seconds:g} s: {true}")


def unfold(view: Any) -> None:
    view.evaluate("for (const details of document.querySelectorAll('details')) details.open = true")


def saved(view: Any, owner: Any, kind: str) -> str:
    """Return the file that the menu of `owner` saves as `kind`."""
    owner.locator(".save").first.click()
    with view.expect_download() as download:
        view.get_by_role("menuitem", name=kind, exact=True).click()
    return Path(download.value.path()).read_bytes().decode("utf-8")


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text, newline="")))
