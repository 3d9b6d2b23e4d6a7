"""Test pages with only the picture comparer, or only its arithmetic; waiting for their panels, and reading them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from reports.data.packing import as_data
from reports.page import script as page_script
from reports.page import shell
from reports.page.script import content_policy, script
from reports.run import pictures
from tests.reports.browsing import opened, until

FILES = ("state.js", "element.js", "numbers.js", "download.js", "filter.js", *pictures.SCRIPTS)
MATHS = ("element.js", "numbers.js", "chunks.js", "kept.js", "pixels.js", "colour_space.js", "delta_e.js", "flip.js",
         "error_maps.js")  # fmt: skip
"""The scripts of the arithmetic."""
SIDE = 48
SHOWN = """([name, column, row, width, height]) => {
    const canvas = document.querySelector(`[data-panel="${name}"] canvas`);
    const scale = Math.min(canvas.width / width, canvas.height / height);
    const x = canvas.width / 2 + (column + .5 - width / 2) * scale;
    const y = canvas.height / 2 + (row + .5 - height / 2) * scale;
    const pixel = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
    pixel.drawImage(canvas, -Math.floor(x), -Math.floor(y));
    return [...pixel.getImageData(0, 0, 1, 1).data].slice(0, 3);
}"""


def write_comparer_page(path: Path, data: dict[str, Any], texts: Mapping[str, str], beside: bool = False) -> Path:
    """Write the comparer with the style and policy of a page; `beside`: the policy allows script files."""
    body = '<section id="pictures"><h2>Pictures</h2><div id="comparer" hidden></div></section>'
    whole = f'<style>{shell.style()}</style><div class="body"><nav></nav><main>{body}</main></div>'
    return _write(path, script(*FILES), whole, "pictures-data", data, texts, beside)


def write_arithmetic_page(path: Path, body: str, texts: Mapping[str, str], given: Any) -> Path:
    """Write a page that runs the scripts of `MATHS` and then `body` on the data `given`; `body` calls `tell` with its
    result, which puts JSON into `#found` and sets the document's title.
    """
    code = "(() => {\n" + "\n".join(page_script.FILES[name].read_text(encoding="utf-8") for name in MATHS)
    code += "\nconst given = element.data('given', null);\n"
    code += "const tell = (found) => { document.getElementById('found').textContent = JSON.stringify(found);"
    code += " document.title = 'done'; };\n" + body + "})();"
    return _write(path, code, '<p id="found"></p>', "given", given, texts)


def _write(
    path: Path, code: str, body: str, name: str, data: Any, texts: Mapping[str, str], beside: bool = False
) -> Path:
    blocks = [f'<script type="application/octet-stream" id="{key}">{text}</script>' for key, text in texts.items()]
    path.write_text(
        f"""<!doctype html><html lang="en"><meta charset="utf-8"><link rel="icon" href="data:,">
<meta http-equiv="Content-Security-Policy" content="{content_policy(code, beside)}">
{body}<script type="application/json" id="{name}">{as_data(data)}</script>
{"".join(blocks)}<script>{code}</script></html>""",
        encoding="utf-8",
    )
    return path


def ready(browser: Any, address: str, choice: str = "at=pictures", **context: Any) -> tuple[Any, list[str]]:
    """Open the page and wait until all of its panels are drawn."""
    context.setdefault("viewport", {"width": 1300, "height": 900})
    view, noise = opened(browser, f"{address}#{choice}", **context)
    settle(view)
    noise.remove(address)
    return view, noise


def settle(view: Any) -> None:
    view.wait_for_selector(".stage .pane")
    until(view, "!document.querySelector('.pane[aria-busy]')")
    view.evaluate("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")


def settle_address(view: Any) -> None:
    """Wait until the address holds the last choice, which `state.js` writes 250 ms after a series of changes."""
    settle(view)
    view.evaluate("new Promise(done => setTimeout(done, 300))")


def shown(view: Any, panel: str, column: int, row: int, width: int = SIDE, height: int = SIDE) -> list[int]:
    """Return the colour on the canvas at a pixel of the picture, which must be shown completely."""
    return list(view.evaluate(SHOWN, [panel, column, row, width, height]))


def bytes_of(picture: np.ndarray, column: int, row: int) -> list[int]:
    return [int(value) for value in np.round(255 * np.clip(picture[row, column].astype(float), 0, 1))]


def cells(view: Any, image: str) -> list[str]:
    """Return the row of a picture in the table of a pixel's numbers, with single spaces."""
    texts = view.locator(f'.probe tr[data-image="{image}"] td').all_text_contents()
    return [" ".join(text.split()) for text in texts]


def asked(view: Any, key: str) -> str | None:
    return view.evaluate("key => new URLSearchParams(location.hash.slice(1)).get(key)", key)
