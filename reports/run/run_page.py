"""Records → report.html: one self-contained file that works offline and makes no requests."""

import re
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from harness.records.study import SHELVES
from reports.claims.claim_list import claims
from reports.claims.estimands import rates_grid, senses_grid
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
from reports.drawing.figure import Plot, plots
from reports.page import shell
from reports.page.grid import Grid
from reports.page.script import content_policy, script
from reports.page.shell import flat
from reports.run import metrics_table, pictures
from reports.run.convergence import convergence, difference_panels, time_to_target
from reports.run.density import amplified_methods, amplifier_over_time, density_histograms, printed_form, units
from reports.run.first_screen import first_screen
from reports.run.metrics_table import comparisons_grid, metrics_grid
from reports.run.pictures import PictureData, picture_data, remove_others, views, write_files
from reports.run.runs_data import RUN_SCRIPTS, density_data, runs_data
from reports.run.work_precision import work
from reports.studies.shelves import WORDS, page_of
from reports.studies.study_page import shelf_shown
from scenes.files.atomic import write_atomically


def page(records: Records, beside: Beside = ALONE) -> str:
    """Return the complete page as text; the measurements `beside` the run have sections of their own."""
    return _page(records, beside, picture_data(records))


def _page(records: Records, beside: Beside, pixels: PictureData | None) -> str:
    environment = shell.environment()
    colours = palette.colours_of(records.methods)
    environment.filters["named"] = lambda text: named(text, colours)
    environment.filters["signed"] = wording.signed
    environment.filters["interval"] = wording.interval
    environment.filters["as_data"] = as_data
    environment.filters["behind"] = behind_difference
    content = _content(records, beside) | _content_beside(records, beside)
    code = script(*SCRIPTS)
    return environment.get_template("page.html").render(
        **content,
        policy=content_policy(code, files=bool(pixels and pixels.files)),
        pixels=pixels,
        script=Markup(code),
        style=_style(content),
        data={"runs": as_data(runs_data(records)), "density": as_data(density_data(records))},
        title=content["headline"].title,
        pages_beside=[
            (page_of(shelf), words.link) for shelf, words in WORDS.items() if (records.out / SHELVES[shelf]).is_file()
        ],
        colours=colours,
        sections=[(name, title) for name, title in SECTIONS if content[name]],
    )


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
CHOOSING = ("work",)
"""The sections in which a reader chooses, with rules of their own."""


def _style(content: dict[str, Any]) -> Markup:
    """Return the styles that the present sections need, each sheet once."""
    own = dict.fromkeys(sheet for name, sheets in SHEETS.items() if content[name] for sheet in sheets)
    rules = Markup("").join(content[name].rules for name in CHOOSING if content[name])
    return shell.style("page.css", "explore.css", *own) + rules


def _content_beside(records: Records, beside: Beside) -> dict[str, Any]:
    """Return the sections of the measurements beside the run."""
    return {
        "stability": shelf_shown(beside.stability, records.out) if beside.stability else None,
        "evidence": shelf_shown(beside.evidence, records.out) if beside.evidence else None,
        "serving": shelf_shown(beside.serving, records.out) if beside.serving else None,
    }


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
        "psnr": {
            "scores": scores_grid(records),
            "differences": differences_grids(records),
            "senses": filled(senses_grid(records)),
            "plots": plots(difference_panels(records), "difference"),
        },
        "units": units(records),
        "as_printed": printed_form(records),
        "convergence": _some(
            steps=plots(convergence(records, "step"), "steps"),
            seconds=plots(convergence(records, "seconds"), "seconds"),
        ),
        "work": work(records),
        "reaching": reaching(records),
        "pictures": views(records),
        "metrics": metrics_grid(records),
        "amplifier": _some(
            density=plots(density_histograms(records), "density"),
            over_time=plots(amplifier_over_time(records), "over-time"),
        ),
        "amplified_methods": amplified_methods(records),
        "claims": chapters(found, in_a_line(records)),
        "folds": folds(found),
        "rates": filled(rates_grid(records)),
        "failures": filled(metrics_table.failures_grid(records)),
        "warnings": filled(metrics_table.warnings_grid(records)),
        "properties": filled(metrics_table.properties_grid(records)),
        "parameters": filled(metrics_table.parameters_grid(records)),
        "left_out": filled(metrics_table.left_out_grid(records)),
        "deviations": run.deviations,
        "comparisons": filled(comparisons_grid(records)),
        "provenance": provenance(records),
    }


def reaching(records: Records) -> dict[str, Any] | None:
    """Return the time to target, with its curves drawn."""
    found = time_to_target(records)
    if found is None:
        return None
    return {"of": found, "everywhere": plots(found.everywhere, "reach"), "scenes": plots(found.scenes, "reach-scene")}


def filled(grid: Grid) -> Grid | None:
    return grid if grid.rows else None


def _some(**parts: list[Plot]) -> dict[str, list[Plot]] | None:
    return parts if any(parts.values()) else None


def provenance(records: Records) -> list[tuple[str, list[tuple[str, str]]]]:
    """Return groups of name and value: how to get the same again."""
    run = records.run
    groups = [
        (
            "Run",
            [("command", run.command), *((f"{name} (wall)", wording.duration(s)) for name, s in run.phases.items())],
        ),
        ("Settings", flat(run.settings)),
        ("Machine and versions", flat(run.provenance)),
    ]
    sets = []
    for scene in run.scenes:
        rendered = [f"{name} {value}" for name, value in flat(scene.rendered)]
        views = [f"{many} {split}" for split, many in scene.views.items() if many]
        sets.append((scene.name, "; ".join([scene.view_set, ", ".join(views), *rendered])))
    groups.append(("View sets", sets))
    return [(title, [(name, value) for name, value in rows if value]) for title, rows in groups if rows]


def named(text: str, colours: dict[str, palette.Colour]) -> Markup:
    """Return text with the methods' names set in their colours, and commands in backticks as code."""
    return shell.with_code(text, lambda plain: _coloured(plain, colours))


def _coloured(text: str, colours: dict[str, palette.Colour]) -> Markup:
    names = sorted(colours, key=len, reverse=True)
    pattern = re.compile(rf"(?<![\w-])({'|'.join(map(re.escape, names))})(?![\w-])")
    parts = []
    for place, part in enumerate(pattern.split(text)):
        known = place % 2 == 1
        parts.append(
            Markup('<b class="name" style="color: var({})">{}</b>').format(colours[part].variable, part)
            if known
            else escape(part)
        )
    return Markup("").join(parts)


def write_page(records: Records, path: Path, beside: Beside = ALONE) -> None:
    """Write beside the place, then rename: a reader never sees half a page, nor one without its pictures."""
    pixels = picture_data(records)
    files = pixels.files if pixels else {}
    write_files(files, path.parent)
    write_atomically(path, _page(records, beside, pixels), fsync=False)
    remove_others(files, path.parent)
