"""The common shell of our pages: policy, template environment, style, settings in words, and how a file is written."""

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from reports.data import wording
from reports.data.selection import Selection
from reports.drawing import palette
from reports.page.grid import Entry
from reports.page.script import content_policy, script


def of_entry(entry: Entry) -> Markup:
    attributes: dict[str, str] = {}
    if isinstance(entry.value, str):
        attributes["said"] = entry.value
    elif entry.value is not None and math.isfinite(entry.value):
        attributes["value"] = f"{entry.value:.7g}"
    parts = {
        name: part if isinstance(part, str) else float(f"{part:.7g}")
        for name, part in entry.parts.items()
        if part is not None and (isinstance(part, str) or math.isfinite(part))
    }
    if parts:
        attributes["parts"] = as_json(parts)
    return _written(attributes) + of_runs(entry.runs)


def of_runs(runs: Selection | None) -> Markup:
    """Return the attribute of a cell that shows the runs behind it; none if there are none."""
    return _written({"runs": as_json(runs.data())} if runs is not None and runs.data() else {})


def of_row(row: list[Entry]) -> Markup:
    """Return the scene and the method that a complete row belongs to, which a filter uses."""
    attributes = {}
    for name in ("scene", "method"):
        values = {getattr(entry.runs, name) for entry in row if entry.runs is not None}
        if len(values) == 1 and (value := values.pop()):
            attributes[name] = value
    return _written(attributes)


def as_json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def _written(attributes: dict[str, str]) -> Markup:
    return Markup("").join(Markup(' data-{}="{}"').format(name, escape(value)) for name, value in attributes.items())


RUN_PAGE = "report.html"
Groups = list[tuple[str, list[tuple[str, str]]]]

HERE = Path(__file__).parent
SCRIPTS = (
    *("state.js", "element.js", "numbers.js", "download.js", "menu.js"),
    *("chart_scale.js", "figure_svg.js", "figures.js", "evidence.js", "runs.js"),
    *("tables.js", "filter.js", "reading.js"),
)
"""The scripts that every page needs to sort, filter and save, in this order."""
START = "start.js"
STYLES = ("page.css", "explore.css", "studies.css", "compare.css", "work.css", "judgement.css")


class Section(NamedTuple):
    """A part of a page with a title and an entry in the contents; its parts are made by the macros of a `Layout`."""

    name: str
    title: str
    parts: list[Markup]
    question: str | None = None
    """The question of a study, which stands below its title; None for anything else."""
    folded: bool = False
    """Whether a reader unfolds it; a link to it does."""


def section(name: str, title: str, *parts: Markup, question: str | None = None, folded: bool = False) -> Section:
    return Section(name, title, [part for part in parts if part.strip()], question, folded)


class Layout:
    """How a page looks: `parts` and `study_parts` are the macros of these templates, `named` colours methods' names."""

    def __init__(self, colours: dict[str, palette.Colour] | None = None) -> None:
        self.colours = colours or {}
        self.environment = environment()
        self.environment.globals["colours"] = self.colours
        self.environment.filters["named"] = self.named
        self.parts: Any = self.environment.get_template("parts.html").make_module()
        self.study_parts: Any = self.environment.get_template("study_parts.html").make_module()

    def named(self, text: str) -> Markup:
        return named(text, self.colours)

    def page(
        self,
        template: str,
        title: str,
        sections: Iterable[Section],
        provenance: Groups,
        *,
        scripts: tuple[str, ...] = (*SCRIPTS, START),
        files: bool = False,
        rules: str = "",
        fold_origins: bool = False,
        **content: object,
    ) -> str:
        """Return a page as text; sections without parts are left out. `files` lets it load script files that lie
        beside it, `rules` are further rules of style.
        """
        origins = [
            self.parts.folded(name, self.parts.terms("provenance", pairs), place == 0)
            for place, (name, pairs) in enumerate(provenance)
        ]
        every = [*sections, section("provenance", "Provenance", *origins, folded=fold_origins)]
        code = script(*scripts)
        return self.environment.get_template(template).render(
            **content,
            title=title,
            sections=[part for part in every if part.parts],
            policy=content_policy(code, files),
            script=Markup(code),
            style=style() + Markup(rules),
        )


def named(text: str, colours: dict[str, palette.Colour]) -> Markup:
    """Return text with the methods' names set in their colours, and commands in backticks as code."""
    names = sorted(colours, key=len, reverse=True)
    pattern = re.compile(rf"(?<![\w-])({'|'.join(map(re.escape, names))})(?![\w-])")
    name = Markup('<b class="name" style="color: var({})">{}</b>')

    def coloured(plain: str) -> Markup:
        parts = pattern.split(plain)  # every second one is a name
        parts = [name.format(colours[part].variable, part) if at % 2 else escape(part) for at, part in enumerate(parts)]
        return Markup("").join(parts)

    return with_code(text, coloured)


def anchor(kind: str, name: str) -> str:
    """The id of a section: readable where the name is a plain word, and no code whatever the name is."""
    readable = name if re.fullmatch("[A-Za-z0-9_]+", name) else "-" + name.encode().hex()
    return f"{kind}-{readable}".replace("_", "-")


def environment() -> Environment:
    """Return an environment that escapes all data, and stops at an undefined name."""
    made = Environment(
        loader=FileSystemLoader(HERE / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters = {"cell_data": of_entry, "row_data": of_row, "runs_data": of_runs, "breakable": breakable}
    made.filters.update(filters | {"code": with_code})
    return made


def breakable(name: str) -> Markup:
    """Return a name that may be broken behind its underscores, where a column is narrow."""
    return Markup("_<wbr>").join(escape(part) for part in name.split("_"))


def with_code(sentence: str, plain: Callable[[str], Markup] = escape) -> Markup:
    """Return a sentence whose commands in backticks are set as code; the words between them as `plain` sets them."""
    parts = enumerate(sentence.split("`"))
    return Markup("").join(Markup("<code>{}</code>").format(part) if at % 2 else plain(part) for at, part in parts)


def style() -> Markup:
    text = "".join((HERE / "style" / name).read_text(encoding="utf-8") for name in STYLES)
    return Markup(text.replace("/* palette */", variables()))


def variables() -> str:
    """Return the palette as CSS: light; dark if the system wants it so, and never on paper."""
    light, dark = (
        "".join(f"{colour.variable}:{getattr(colour, tone)};" for colour in (*palette.EVERY, *palette.SURFACES))
        for tone in ("light", "dark")
    )
    in_the_dark = f"@media screen and (prefers-color-scheme:dark){{:root{{color-scheme:dark;{dark}}}}}"
    return f":root{{color-scheme:light;{light}}}{in_the_dark}"


def flat(data: Mapping[str, object], prefix: str = "") -> list[tuple[str, str]]:
    """Map nested settings as `a.b` → text."""
    rows = []
    for name, value in data.items():
        if isinstance(value, dict):
            rows += flat(value, f"{prefix}{name}.")
        else:
            rows.append((f"{prefix}{name}", plain(value)))
    return rows


def plain(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(plain, value))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return wording.NOTHING if value is None else str(value)


def groups_of(origin: Mapping[str, object], settings: Mapping[str, object], spent: list[tuple[str, str]]) -> Groups:
    groups = [("Machine and versions", flat(origin)), ("Settings", flat(settings)), ("Wall time", spent)]
    return [(title, rows) for title, rows in groups if rows]
