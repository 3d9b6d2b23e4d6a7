"""Records → report.html: one self-contained file that works offline and makes no requests."""

import re
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from harness.records.study import SHELVES
from reports.claims.claim_list import claims
from reports.claims.estimands import rates_grid, senses_grid
from reports.claims.first_screen import first_screen
from reports.claims.headline import headline, roles
from reports.claims.ledger import in_short, not_tested
from reports.claims.psnr_table import differences_grids, scores_grid
from reports.claims.table import chapters, folds
from reports.data import wording
from reports.data.beside import ALONE, Beside
from reports.data.load import Records
from reports.data.packing import as_data
from reports.data.scale import facts, in_a_line, is_paper_scale, standing
from reports.data.selection import behind_difference
from reports.drawing import palette
from reports.page import shell
from reports.page.grid import Grid
from reports.page.script import content_policy, script
from reports.page.shell import flat
from reports.run import metrics_table, pictures
from reports.run.curves import work
from reports.run.density import amplified_methods, printed_form, units
from reports.run.figures import figures_drawn
from reports.run.pictures import PictureData, picture_data, remove_others, views, write_files
from reports.run.runs_data import RUN_SCRIPTS, density_data, runs_data
from reports.run.time_to_target import time_to_target
from reports.studies.shelves import WORDS, page_of
from reports.studies.study_page import ShelfShown, shelf_shown
from scenes.files.atomic import write_atomically

SECTIONS = (
    ("psnr", "PSNR"),
    ("units", "The unit of density"),
    ("evidence", "Evidence"),
    ("convergence", "Convergence"),
    ("work", "Error against run time"),
    ("reaching", "Time to target"),
    ("pictures", "Pictures"),
    ("serving", "View cache and attention (§8)"),
    ("metrics", "Other scores"),
    ("amplifier", "Amplifier"),
    ("stability", "Numerical stability"),
    ("claims", "The paper’s claims"),
    ("rates", "Failure rates"),
    ("failures", "Unfinished cells"),
    ("warnings", "Warnings"),
    ("properties", "Measured properties"),
    ("parameters", "Weights"),
    ("left_out", "Left out"),
    ("deviations", "Deviations"),
    ("comparisons", "Every comparison"),
    ("provenance", "Provenance"),
)
TABLES = {
    "rates": rates_grid,
    "failures": metrics_table.failures_grid,
    "warnings": metrics_table.warnings_grid,
    "properties": metrics_table.properties_grid,
    "parameters": metrics_table.parameters_grid,
    "left_out": metrics_table.left_out_grid,
}
"""The sections that are a single table."""
SHEETS = {
    "stability": ("studies.css",),
    "evidence": ("studies.css",),
    "work": ("work.css",),
    "serving": ("studies.css",),
    "pictures": ("compare.css",),
}
"""Map section → the style sheets that it needs besides that of the page."""
SCRIPTS = (*shell.SCRIPTS, *RUN_SCRIPTS, *pictures.SCRIPTS, shell.START)
"""The scripts in this order, in one scope."""


def page(records: Records, beside: Beside = ALONE) -> str:
    """Return the complete page as text; the measurements `beside` the run have sections of their own."""
    return _page(records, beside, picture_data(records), {})


def _page(records: Records, beside: Beside, pixels: PictureData | None, shown: dict[str, ShelfShown]) -> str:
    environment = shell.environment()
    colours = palette.colours_of(records.methods)
    environment.filters["named"] = lambda text: named(text, colours)
    environment.filters["signed"] = wording.signed
    environment.filters["interval"] = wording.interval
    environment.filters["as_data"] = as_data
    environment.filters["behind"] = behind_difference
    studies = {"stability": beside.stability, "evidence": beside.evidence, "serving": beside.serving}
    content = _content(records, beside) | {
        shelf: (shown.get(shelf) or shelf_shown(record, records.out)) if record else None
        for shelf, record in studies.items()
    }
    there = {**content, **content["tables"], **content["plotted"], "psnr": True}
    there["amplifier"] = content["plotted"]["amplifier"] or content["plotted"]["learned"]
    own = dict.fromkeys(sheet for section, sheets in SHEETS.items() if content[section] for sheet in sheets)
    style = shell.style("page.css", "explore.css", *own)
    if content["work"]:
        style += content["work"]["rules"]
    code = script(*SCRIPTS)
    return environment.get_template("page.html").render(
        **content,
        policy=content_policy(code, files=bool(pixels and pixels.files)),
        pixels=pixels,
        script=Markup(code),
        style=style,
        data={"runs": as_data(runs_data(records)), "density": as_data(density_data(records))},
        title=content["headline"].title,
        pages_beside=[
            (page_of(shelf), words.link) for shelf, words in WORDS.items() if (records.out / SHELVES[shelf]).is_file()
        ],
        colours=colours,
        sections=[(name, title) for name, title in SECTIONS if there.get(name)],
    )


def _content(records: Records, beside: Beside) -> dict[str, Any]:
    """Return the content of each section; an empty one is left out with its entry in the contents."""
    run, found = records.run, claims(records, beside)
    missing = not_tested(run.not_tested, found)
    return {
        "records": records,
        "run": run,
        "headline": headline(records),
        "cast": roles(records),
        "first": first_screen(records, found, beside),
        "facts": facts(records),
        "scale": in_a_line(records),
        "standing": standing(records),
        "at_paper_scale": is_paper_scale(records),
        "expected": len(run.scenes) * len(run.methods) * len(run.seeds),
        "failed": records.failed,
        "not_tested": missing,
        "not_tested_in_short": in_short(missing),
        "warned": sum(bool(cell.warnings) for cell in records.cells),
        "warning_kinds": metrics_table.warning_kinds(records),
        "plotted": figures_drawn(records),
        "psnr": {
            "scores": scores_grid(records),
            "differences": differences_grids(records),
            "senses": filled(senses_grid(records)),
        },
        "units": units(records),
        "as_printed": printed_form(records),
        "work": work(records),
        "reaching": time_to_target(records),
        "pictures": views(records),
        "metrics": metrics_table.metrics_grid(records),
        "amplified_methods": amplified_methods(records),
        "claims": chapters(found, in_a_line(records)),
        "folds": folds(found),
        "tables": {name: grid for name, made in TABLES.items() if (grid := filled(made(records)))},
        "deviations": run.deviations,
        "comparisons": filled(metrics_table.comparisons_grid(records)),
        "provenance": provenance(records),
    }


def filled(grid: Grid) -> Grid | None:
    return grid if grid.rows else None


def provenance(records: Records) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return groups of name and value: how to get the same again."""
    run = records.run
    phases = [(f"{name} (wall)", wording.duration(seconds)) for name, seconds in run.phases.items()]
    sets = []
    for scene in run.scenes:
        views = ", ".join(f"{many} {split}" for split, many in scene.views.items() if many)
        rendered = [f"{name} {value}" for name, value in flat(scene.rendered)]
        sets.append((scene.name, "; ".join([scene.view_set, views, *rendered])))
    groups = [
        ("Run", [("command", run.command), *phases]),
        ("Settings", flat(run.settings)),
        ("Machine and versions", flat(run.provenance)),
        ("View sets", sets),
    ]
    return [(title, [(name, value) for name, value in rows if value]) for title, rows in groups if rows]


def named(text: str, colours: dict[str, palette.Colour]) -> Markup:
    """Return text with the methods' names set in their colours, and commands in backticks as code."""
    names = sorted(colours, key=len, reverse=True)
    pattern = re.compile(rf"(?<![\w-])({'|'.join(map(re.escape, names))})(?![\w-])")
    name = Markup('<b class="name" style="color: var({})">{}</b>')

    def coloured(plain: str) -> Markup:
        parts = pattern.split(plain)  # every second one is a name
        parts = [name.format(colours[part].variable, part) if at % 2 else escape(part) for at, part in enumerate(parts)]
        return Markup("").join(parts)

    return shell.with_code(text, coloured)


def write_page(
    records: Records, path: Path, beside: Beside = ALONE, shown: dict[str, ShelfShown] | None = None
) -> None:
    """Write beside the place, then rename: a reader never sees half a page, nor one without its pictures.

    `shown` holds the sections of studies that were made already, by shelf.
    """
    pixels = picture_data(records)
    files = pixels.files if pixels else {}
    write_files(files, path.parent)
    write_atomically(path, _page(records, beside, pixels, shown or {}), fsync=False)
    remove_others(files, path.parent)
