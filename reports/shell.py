"""What every page of ours shares: policy, template environment, style, settings in words, and how a file is written."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from reports import attributes, palette, wording
from reports.script import script

RUN_PAGE = "report.html"
SPEED_PAGE = "speed.html"
SPEED_FILE = "speed.json"
STABILITY_PAGE = "stability.html"
EVIDENCE_PAGE = "evidence.html"

HERE = Path(__file__).parent
SCRIPTS = (
    *("state.js", "element.js", "numbers.js", "download.js", "menu.js"),
    *("chart_scale.js", "figure_svg.js", "figures.js", "runs.js", "drawn_tables.js"),
    *("tables.js", "filter.js", "reading.js"),
)
"""What every page needs to sort, filter and save, in this order."""
START = "start.js"
"""The last script of a page."""


def environment() -> Environment:
    """Escapes whatever comes from data, and stops at a name that nobody gave."""
    made = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    made.filters["breakable"] = breakable
    made.filters["code"] = with_code
    made.filters["cell_data"] = attributes.of_entry
    made.filters["row_data"] = attributes.of_row
    made.filters["as_json"] = attributes.as_json
    made.filters["runs_data"] = attributes.of_runs
    return made


def code() -> str:
    """The script of a page without runs of its own: its tables and figures can be sorted, filtered and saved."""
    return script(*SCRIPTS, START)


def breakable(name: str) -> Markup:
    """A name that may be broken behind its underscores, where a column is narrow."""
    return Markup("_<wbr>").join(escape(part) for part in name.split("_"))


def with_code(sentence: str, plain: Callable[[str], Markup] = escape) -> Markup:
    """A sentence whose commands stand in backticks, as code; the words between them as `plain` sets them."""
    parts = enumerate(sentence.split("`"))
    return Markup("").join(Markup("<code>{}</code>").format(part) if at % 2 else plain(part) for at, part in parts)


def style(*files: str) -> Markup:
    """Style sheets in order, with the palette where the first one wants it."""
    text = "".join((HERE / name).read_text(encoding="utf-8") for name in files)
    return Markup(text.replace("/* palette */", variables()))


def variables() -> str:
    """The palette as CSS: light; dark where the system or the reader wants it so, and never on paper."""
    light, dark = (
        "".join(f"{colour.variable}:{getattr(colour, tone)};" for colour in (*palette.EVERY, *palette.SURFACES))
        for tone in ("light", "dark")
    )
    return (
        f":root{{color-scheme:light;{light}}}"
        f"@media screen and (prefers-color-scheme:dark){{:root:not([data-theme=light]){{color-scheme:dark;{dark}}}}}"
        f"@media screen{{:root[data-theme=dark]{{color-scheme:dark;{dark}}}}}"
    )


def flat(data: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested settings as `a.b` → text."""
    rows = []
    for name, value in data.items():
        if isinstance(value, dict):
            rows += flat(value, f"{prefix}{name}.")
        else:
            rows.append((f"{prefix}{name}", plain(value)))
    return rows


def plain(value: Any) -> str:
    """A setting as a reader writes it."""
    if isinstance(value, list):
        return ", ".join(map(plain, value))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return wording.NOTHING if value is None else str(value)


def groups_of(
    origin: dict[str, Any], settings: dict[str, Any], spent: list[tuple[str, str]]
) -> list[tuple[str, list[tuple[str, str]]]]:
    """Where a record comes from, as groups of name and value; those with nothing in them are left out."""
    groups = [("Machine and versions", flat(origin)), ("Settings", flat(settings)), ("Wall time", spent)]
    return [(title, rows) for title, rows in groups if rows]


def write_whole(text: str, path: Path) -> None:
    """Beside its place, then renamed: a reader never sees half a page."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        beside.write_text(text, encoding="utf-8")
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
