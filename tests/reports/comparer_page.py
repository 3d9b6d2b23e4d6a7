"""Pages that hold the picture comparer, or its arithmetic, alone: what these are tested on."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from reports.data.packing import as_data
from reports.page import script as page_script
from reports.page import shell
from reports.page.script import content_policy, script
from reports.run import pictures

FILES = ("state.js", "element.js", "numbers.js", "download.js", "filter.js", *pictures.SCRIPTS)
ALONE = ("element.js", "numbers.js", "chunks.js", "kept.js", "pixels.js", "colour_space.js", "delta_e.js", "flip.js",
         "error_maps.js")  # fmt: skip
"""What the arithmetic needs."""


def write_comparer_page(path: Path, data: dict[str, Any], texts: Mapping[str, str], beside: bool = False) -> Path:
    """The comparer with the page's own style and policy; `beside`: which may load script files."""
    body = '<section id="pictures"><h2>Pictures</h2><div id="comparer" hidden></div></section>'
    whole = f'<style>{shell.style()}</style><div class="body"><nav></nav><main>{body}</main></div>'
    return _write(path, script(*FILES), whole, "pictures-data", data, texts, beside)


def write_arithmetic_page(path: Path, body: str, texts: Mapping[str, str], given: Any) -> Path:
    """A page that runs the named scripts of ours and then `body`, which sets the document's title when it is done and
    leaves JSON in `#found`; `given` is its data.
    """
    code = "(() => {\n" + "\n".join(page_script.FILES[name].read_text(encoding="utf-8") for name in ALONE)
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
