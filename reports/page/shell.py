"""The shell that all pages share: policy, template environment, style, and settings as text."""

import math
import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from harness.records.json_record import flat
from reports.data import wording
from reports.data.packing import as_data, as_json
from reports.drawing import palette
from reports.page.grid import Entry
from reports.page.script import content_policy, script


def entry_data(entry: Entry) -> Markup:
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
    if entry.runs is not None and (runs := entry.runs.data()):
        attributes["runs"] = as_json(runs)
    return _attributes(attributes)


def row_data(row: list[Entry]) -> Markup:
    """Return the scene and the method that all entries of a row belong to, for the filter."""
    attributes = {}
    for name in ("scene", "method"):
        values = {getattr(entry.runs, name) for entry in row if entry.runs is not None}
        if len(values) == 1 and (value := values.pop()):
            attributes[name] = value
    return _attributes(attributes)


def _attributes(attributes: dict[str, str]) -> Markup:
    return Markup("").join(Markup(' data-{}="{}"').format(name, escape(value)) for name, value in attributes.items())


RUN_PAGE = "report.html"
Groups = list[tuple[str, list[tuple[str, str]]]]

HERE = Path(__file__).parent
SCRIPTS = (
    *("state.js", "element.js", "numbers.js", "download.js", "menu.js"),
    *("chart_scale.js", "chart_view.js", "figure_svg.js", "figures.js", "evidence.js", "runs.js"),
    *("tables.js", "filter.js", "reading.js", "newer.js"),
)
"""The scripts of every page, for sorting, filtering and saving, in this order."""
START = "start.js"
STYLES = ("page.css", "explore.css", "studies.css", "compare.css", "work.css", "judgement.css")


class Section(NamedTuple):
    """A section of a page with a title and an entry in the contents; the macros of a `Layout` make its parts."""

    name: str
    title: str
    parts: list[Markup]
    question: str | None = None
    """The question of a study; None for other sections."""
    answer: str = ""
    """The answer of a study, its heading."""
    folded: bool = False
    """Whether it is folded at first; a link to it unfolds it."""


def section(
    name: str, title: str, *parts: Markup, question: str | None = None, answer: str = "", folded: bool = False
) -> Section:
    return Section(name, title, [part for part in parts if part.strip()], question, answer, folded)


class Layout:
    """The templates of a page: `parts` and `study_parts` are their macros, `named` colours the names of methods."""

    def __init__(self, colours: dict[str, palette.Colour] | None = None) -> None:
        self.colours = colours or {}
        self.environment = environment()
        self.named = partial(named, colours=self.colours)
        self.environment.globals["colours"] = self.colours
        self.environment.filters["named"] = self.named
        self.parts: Any = self.environment.get_template("parts.html").make_module()
        self.study_parts: Any = self.environment.get_template("study_parts.html").make_module()

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
        groups: Mapping[str, tuple[str, ...]] | None = None,
        before: Iterable[tuple[str, str]] = (),
        **content: object,
    ) -> str:
        """Return a page as text; sections without parts are left out. `files` allows script files next to the page.

        `groups`: title in the contents → names of its sections, in the order of the page; the last group takes the
        others. `before`: id and title of what stands above all sections, the beginning of the first group.
        """
        origins = [
            self.parts.folded(name, self.parts.terms("provenance", pairs), place == 0)
            for place, (name, pairs) in enumerate(provenance)
        ]
        every = [*sections, section("provenance", "Provenance", *origins, folded=fold_origins)]
        grouped = in_groups([part for part in every if part.parts], groups or {"": ()})
        contents = [(group, [(part.name, part.title) for part in parts]) for group, parts in grouped.items()]
        contents[0][1][:0] = before
        code = script(*scripts)
        return self.environment.get_template(template).render(
            **content,
            title=title,
            sections=[part for parts in grouped.values() for part in parts],
            contents=[(group, entries) for group, entries in contents if entries],
            policy=content_policy(code, files),
            script=Markup(code),
            style=style() + Markup(rules),
        )


def in_groups(sections: list[Section], groups: Mapping[str, tuple[str, ...]]) -> dict[str, list[Section]]:
    """Map group → its sections, in the order of `groups`; the last group takes the sections that none names."""
    places = {name: group for group, names in groups.items() for name in names}
    *_, last = groups
    ordered = [name for names in groups.values() for name in names]
    ranked = sorted(sections, key=lambda part: ordered.index(part.name) if part.name in ordered else len(ordered))
    return {group: [part for part in ranked if places.get(part.name, last) == group] for group in groups}


def named(text: str, colours: dict[str, palette.Colour]) -> Markup:
    """Return text with the names of methods in their colours, and commands in backticks as code."""
    names = sorted(colours, key=len, reverse=True)
    pattern = re.compile(rf"(?<![\w-])({'|'.join(map(re.escape, names))})(?![\w-])")
    name = Markup('<b class="name" style="color: var({})">{}</b>')

    def coloured(plain: str) -> Markup:
        parts = pattern.split(plain)  # every second part is a name
        parts = [name.format(colours[part].variable, part) if at % 2 else escape(part) for at, part in enumerate(parts)]
        return Markup("").join(parts)

    return with_code(text, coloured)


def anchor(kind: str, name: str) -> str:
    readable = name if re.fullmatch("[A-Za-z0-9_]+", name) else "-" + name.encode().hex()
    return f"{kind}-{readable}".replace("_", "-")


def environment() -> Environment:
    """Return an environment that escapes all data, and raises an error for an undefined name."""
    made = Environment(
        loader=FileSystemLoader(HERE / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters = {"cell_data": entry_data, "row_data": row_data, "as_data": as_data, "breakable": breakable}
    made.filters.update(filters | {"code": with_code})
    return made


def breakable(name: str) -> Markup:
    return Markup("_<wbr>").join(escape(part) for part in name.split("_"))


def with_code(sentence: str, plain: Callable[[str], Markup] = escape) -> Markup:
    """Return a sentence whose commands in backticks are marked as code; `plain` marks up the text between them."""
    parts = enumerate(sentence.split("`"))
    return Markup("").join(Markup("<code>{}</code>").format(part) if at % 2 else plain(part) for at, part in parts)


def style() -> Markup:
    text = "".join((HERE / "style" / name).read_text(encoding="utf-8") for name in STYLES)
    return Markup(text.replace("/* palette */", variables()))


def variables() -> str:
    """Return the palette as CSS: light, or dark if the system prefers it and the page is not printed."""
    light, dark = (
        "".join(f"{colour.variable}:{getattr(colour, tone)};" for colour in (*palette.EVERY, *palette.SURFACES))
        for tone in ("light", "dark")
    )
    in_the_dark = f"@media screen and (prefers-color-scheme:dark){{:root{{color-scheme:dark;{dark}}}}}"
    return f":root{{color-scheme:light;{light}}}{in_the_dark}"


def settings_rows(settings: Mapping[str, object]) -> list[tuple[str, str]]:
    """Return the name and the text of each of nested settings."""
    return [(name, plain(value)) for name, value in flat(settings)]


def plain(value: object) -> str:
    if isinstance(value, list):
        return ", ".join(map(plain, value))
    if isinstance(value, bool):
        return "yes" if value else "no"
    return wording.NOTHING if value is None else str(value)


def groups_of(origin: Mapping[str, object], settings: Mapping[str, object], spent: list[tuple[str, str]]) -> Groups:
    groups = [
        ("Machine and versions", settings_rows(origin)),
        ("Settings", settings_rows(settings)),
        ("Wall time", spent),
    ]
    return [(title, rows) for title, rows in groups if rows]
