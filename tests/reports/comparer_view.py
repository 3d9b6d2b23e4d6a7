"""The comparer's page in a browser: waiting for its panels, and what is seen on them."""

from typing import Any

import numpy as np

from tests.reports.browsing import opened, until

SIDE = 48
SHOWN = """([name, column, row, width, height]) => {
    const canvas = document.querySelector(`[data-panel="${name}"] canvas`);
    const scale = Math.min(canvas.width / width, canvas.height / height);
    const x = canvas.width / 2 + (column + .5 - width / 2) * scale;
    const y = canvas.height / 2 + (row + .5 - height / 2) * scale;
    const one = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
    one.drawImage(canvas, -Math.floor(x), -Math.floor(y));
    return [...one.getImageData(0, 0, 1, 1).data].slice(0, 3);
}"""


def ready(browser: Any, address: str, choice: str = "at=pictures", **context: Any) -> tuple[Any, list[str]]:
    """The page with all of its panels drawn."""
    context.setdefault("viewport", {"width": 1300, "height": 900})
    view, noise = opened(browser, f"{address}#{choice}", **context)
    settle(view)
    noise.remove(address)
    return view, noise


def settle(view: Any) -> None:
    view.wait_for_selector(".stage .pane")
    until(view, "!document.querySelector('.pane[aria-busy]')")
    view.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def shown(view: Any, panel: str, column: int, row: int, width: int = SIDE, height: int = SIDE) -> list[int]:
    """The colour on the canvas where a picture's pixel lies, while the whole picture is shown."""
    return list(view.evaluate(SHOWN, [panel, column, row, width, height]))


def bytes_of(picture: np.ndarray, column: int, row: int) -> list[int]:
    return [int(value) for value in np.round(255 * np.clip(picture[row, column].astype(float), 0, 1))]


def cells(view: Any, image: str) -> list[str]:
    """A picture's row in the table of a pixel's numbers, with single spaces."""
    texts = view.locator(f'.probe tr[data-image="{image}"] td').all_text_contents()
    return [" ".join(text.split()) for text in texts]


def asked(view: Any, key: str) -> str | None:
    """A key of the address."""
    return view.evaluate("key => new URLSearchParams(location.hash.slice(1)).get(key)", key)
