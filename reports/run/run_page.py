"""Records → report.html: one self-contained file that works offline and makes no requests."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from markupsafe import Markup

from harness.records.cells import RunRecord
from harness.records.study import SHELVES
from harness.records.targets import TargetsRecord
from reports.claims.claim_list import claims
from reports.claims.estimands import rates_grid, senses_grid
from reports.claims.first_screen import first_screen
from reports.claims.headline import headline
from reports.claims.ledger import Claim, in_short, not_tested
from reports.claims.psnr_table import differences_grids, scores_grid
from reports.claims.table import chapters, folds
from reports.data import glossary, wording
from reports.data.load import Records
from reports.data.packing import as_data, as_json
from reports.data.scale import compared_with, facts, in_a_line, is_at_scale, standing
from reports.data.studies_load import NO_SHELVES, ShelfRecords
from reports.drawing.figure import plots
from reports.drawing.palette import colours_of
from reports.page import shell
from reports.page.shell import Layout, Section, section, settings_rows
from reports.run import metrics_table, pictures
from reports.run.ceiling import ceilings
from reports.run.curves import Diagram, chooser_rules, diagrams
from reports.run.density import amplified_methods, further_grid, printed_form, separation_grid
from reports.run.figures import FIGURES, MARGIN, ruler
from reports.run.pictures import PictureData, exhibit, picture_data, remove_others, views, write_files
from reports.run.runs_data import RUN_SCRIPTS, density_data, runs_data
from reports.run.saving.citation import bibtex, records_digest
from reports.run.time_to_target import at_risk_grid, notes, savings_grid, target_title
from reports.run.turn import rounds
from reports.studies.shelves import WORDS, page_of
from reports.studies.study_page import ShelfShown, shelf_shown
from scenes.files.atomic import write_atomically

SCRIPTS = (*shell.SCRIPTS, *RUN_SCRIPTS, *pictures.SCRIPTS, shell.START)
HEADING = Markup("<h3>{}</h3>")
VERSION_FILE = "report.version.js"
MUTED = Markup('<i class="swatch" style="background: var(--muted)"></i>')
GROUPS = {
    "Answer": ("claims",),
    "Scores": ("psnr", "metrics", "further", "comparisons"),
    "Time": ("convergence", "work", "reaching", "costs"),
    "Pictures": ("pictures",),
    "Interior": ("amplifier", "properties", "parameters", "left_out"),
    "Evidence and limits": ("evidence", "stability", "serving", "rates", "failures", "warnings", "deviations"),
}
"""Title in the contents → the sections of its group, in the order of the page."""
TABLES = {
    "Failure rates": ("rates", rates_grid),
    "Unfinished cells": ("failures", metrics_table.failures_grid),
    "Warnings": ("warnings", metrics_table.warnings_grid),
    "Measured properties": ("properties", metrics_table.properties_grid),
    "Weights": ("parameters", metrics_table.parameters_grid),
    "Left out": ("left_out", metrics_table.left_out_grid),
}
CONVERGENCE = (
    "Thin: one seed. Thick: mean of the finished seeds. A cross: where a run diverged. Dashed: the floor (copying the "
    "nearest training view) and, where it is near, the ceiling (noise of the ground truth). "
    "Core seconds: processor time of all threads, only in training, on a GPU the host's. Other programs on the "
    "machine make wall times too long, and change core seconds little."
)
WORK = (
    "Lower and further left is better. Thin: one seed. Thick: the geometric mean of the finished seeds, over all "
    "scenes too. Band: one standard deviation over the seeds, up and down in error, left and right in cost. A cross: "
    "where a run diverged. Dashed: the error that the noise of the ground truth itself causes, carried over from the "
    "PSNR ceiling to linear light; for the other errors it is not known."
)
AMPLIFIER = (
    "Densities at points spread over the scene’s box: means over the finished seeds (over all seeds if none finished) "
    "at the last step that they share. Both axes are logarithmic where the bins are; empty bins lie on the lower axis."
)
CLAIMS = Markup(
    "{}: {}. Intervals are 95 %, on these scenes, and widened where several claims are looked at together. At its own "
    "scale a gain or level is <i>reproduced</i> where its interval lies within ± 0.2 dB (0.005 of SSIM, 5 "
    "percentage points of a saving) of what is printed, and <i>not reproduced</i> where it lies outside. At another "
    "scale a gain is <i>seen</i> where its interval lies above 0 and reaches to within that distance of what is "
    "printed, and <i>not seen at this scale</i> where it does not reach there. What needs no training – weights, sums, "
    "means – is reproduced or not. A bound has no margin. All else is <i>inconclusive</i>."
)


def page(records: Records, shelves: ShelfRecords = NO_SHELVES) -> str:
    """Return the complete page, with a section for each record of `shelves`."""
    return _page(records, shelves, picture_data(records), {})


def _page(records: Records, shelves: ShelfRecords, pixels: PictureData | None, shown: dict[str, ShelfShown]) -> str:
    layout = Layout(colours_of(records.pictured))
    run, ledger = records.run, claims(records, shelves)
    studies = [record for record in (shelves.evidence, shelves.stability, shelves.serving) if record is not None]
    shown = {record.shelf: shown.get(record.shelf) or shelf_shown(record) for record in studies}
    work, missing = diagrams(records), not_tested(run.not_tested, ledger)
    answer, source = headline(records), compared_with(records)
    measured = list(filter(None, [ruler(records)]))
    return layout.page(
        "page.html",
        answer.title,
        _sections(_Content(records, layout, ledger, shown, pixels, work)),
        provenance(records),
        fold_origins=True,
        scripts=SCRIPTS,
        files=bool(pixels and pixels.files) or not run.finished,
        rules=chooser_rules(work),
        groups=GROUPS,
        before=[("answer", ""), *([("not-tested", "Not tested")] if missing else [])],
        newest=None if run.finished else {"file": VERSION_FILE, "version": version(records)},
        records=records,
        run=run,
        headline=answer,
        exhibit=exhibit(records),
        ruler=next(iter(plots(measured, "ruler")), None),
        claimed=any(trace.label == "claimed" for panel in measured for trace in panel.traces),
        margin=f"{MARGIN:g}",
        stability=shown.get("stability"),
        first=first_screen(records, ledger, shelves),
        facts=facts(records),
        scale=in_a_line(records),
        source=source,
        at_scale=source is None or is_at_scale(records, source),
        as_printed=printed_form(records),
        ceilings=ceilings(records),
        expected=expected_cells(run),
        not_tested=missing,
        not_tested_in_short=in_short(missing),
        warned=sum(bool(cell.all_warnings) for cell in records.cells),
        warning_kinds=metrics_table.warning_kinds(records),
        waiting=metrics_table.waiting(records),
        pages_beside=[
            (page_of(shelf), words.link) for shelf, words in WORDS.items() if (records.out / SHELVES[shelf]).is_file()
        ],
        broken=[shelf for shelf in shown.values() if shelf.broken and not shelf.record.is_quick],
        pixels=pixels,
        data={"runs": as_data(runs_data(records)), "density": as_data(density_data(records))},
    )


class _Content(NamedTuple):
    records: Records
    layout: Layout
    ledger: list[Claim]
    shelves: dict[str, ShelfShown]
    pixels: PictureData | None
    work: list[Diagram]

    @property
    def keys(self) -> list[tuple[Markup, str]]:
        return [(self.layout.parts.swatch(method), method) for method in self.records.methods]

    def figures(self, name: str) -> Markup:
        """Lay out the figures of a section: panels of all scenes together first, those of single scenes folded."""
        parts, several = self.layout.parts, len(self.records.scenes) > 1
        shown, together, by_scene = Markup(""), [], Markup("")
        for figure in FIGURES:
            if figure.section != name or not (drawn := plots(figure.panels(self.records), figure.name)):
                continue
            if figure.all_first and several:
                together.append(drawn[0])
                by_scene += parts.folded(f"{figure.title}, scene by scene", parts.figures(drawn[1:]))
                continue
            shown += HEADING.format(figure.title) if figure.title else ""
            shown += parts.legend(self.keys, figure.legend) if figure.legend else ""
            shown += parts.figures(drawn, "pairs" if figure.wide else "")
            shown += parts.paragraph(self.layout.named(figure.note), "note")
        return (parts.figures(together) if together else "") + by_scene + shown

    def shelf(self, name: str) -> Section:
        shown = filter(None, [self.shelves.get(name)])
        return folded(name, WORDS[name].title, *map(self.layout.study_parts.shelf, shown))


def folded(name: str, title: str, *content: Markup) -> Section:
    return section(name, title, *content, folded=True)


def _sections(content: _Content) -> Iterator[Section]:
    records, parts = content.records, content.layout.parts
    scores = [scores_grid(records), senses_grid(records), *differences_grids(records)]
    yield section("psnr", "PSNR", *map(parts.table, scores), content.figures("psnr"))
    printed = printed_form(records)
    reading = parts.paragraph(content.layout.named(printed)) if printed else Markup("")
    yield folded("further", "Further methods", reading, parts.table(further_grid(records)))
    yield content.shelf("evidence")
    yield from _training(content)
    if (targets := records.targets) is not None:
        yield _time_to_target(content, targets)
    yield from _pictures(content)
    yield folded("metrics", "Other scores", parts.table(metrics_table.metrics_grid(records), False))
    yield _amplifier(content)
    yield content.shelf("stability")
    yield from _claims(content)
    for title, (name, grid) in TABLES.items():
        yield folded(name, title, parts.table(grid(records), False))
    yield content.shelf("serving")
    yield folded("deviations", "Deviations from the paper", parts.bullets(records.run.deviations))
    yield folded("words", "Glossary", parts.terms("provenance", glossary.WORDS))
    how = "`python -m reports OUT --export FILE.zip` writes all figures (PDF, SVG, PNG) and tables (CSV, LaTeX)."
    cited = Markup('<pre class="cite">{}</pre>').format(bibtex(records))
    yield folded("cite", "Cite this run, save all", parts.paragraph(shell.with_code(how)), cited)
    compared = metrics_table.comparisons_grid(records)
    many = f"{len(compared.rows)} paired comparisons with intervals and smallest detectable differences"
    every = parts.folded(many, parts.table(compared, False)) if compared.rows else Markup("")
    yield folded("comparisons", "Every comparison", every)


def _training(content: _Content) -> Iterator[Section]:
    records, parts = content.records, content.layout.parts
    if converging := content.figures("convergence"):
        curved = {cell.method for cell in records.guest_cells if cell.curve}
        guests = [(parts.swatch(guest), guest) for guest in records.run.guests if guest in curved]
        yield section("convergence", "Convergence", parts.legend([*content.keys, *guests], CONVERGENCE), converging)
    if content.work:
        chooser = parts.chooser(content.work, [plots(diagram.panels, diagram.name) for diagram in content.work])
        yield section("work", "Error against run time", parts.legend(content.keys, WORK), chooser)
    yield section("costs", "Costs", parts.table(metrics_table.costs_grid(records), False))


def _time_to_target(content: _Content, targets: TargetsRecord) -> Section:
    parts, named, scenes = content.layout.parts, content.layout.named, content.records.scenes
    by_scene = [content.figures("reaching_scenes")]
    by_scene += [parts.table(savings_grid(targets, scenes), own="own")] if by_scene[0] else []
    return section(
        "reaching",
        target_title(targets),
        parts.paragraph(named(targets.declared)),
        parts.table(savings_grid(targets, ["all"])),
        content.figures("reaching"),
        parts.folded("Numbers at risk", parts.table(at_risk_grid(targets), False)),
        *(parts.paragraph(named(sentence), "note") for sentence in notes(targets)),
        parts.folded("Scene by scene", Markup("").join(by_scene)) if by_scene[0] else Markup(""),
    )


def _pictures(content: _Content) -> Iterator[Section]:
    parts, pixels = content.layout.parts, content.pixels
    if still := views(content.records):
        beside = parts.paragraph(pixels.data["beside"], "alert mild") if pixels else Markup("")
        around = rounds(content.records)
        turn = parts.folded("A turn around each scene", parts.turn(around)) if around else Markup("")
        yield section("pictures", "Pictures", beside, parts.comparer(still), turn)


def _amplifier(content: _Content) -> Section:
    records, parts, density = content.records, content.layout.parts, content.figures("amplifier")
    after = [(parts.swatch(method), f"density after it, {method}") for method in amplified_methods(records)]
    legend = parts.legend([(MUTED, "density before the amplifier"), *after], AMPLIFIER) if density else Markup("")
    learned, truth = content.figures("learned"), parts.table(separation_grid(records))
    return folded("amplifier", "Amplifier", legend, density, learned, truth)


def _claims(content: _Content) -> Iterator[Section]:
    records, parts, here = content.records, content.layout.parts, in_a_line(content.records)
    if tested := chapters(content.ledger, here):
        judged = [HEADING.format(title) + parts.table(grid, False) for title, grid in tested]
        untested = [
            parts.folded(shell.with_code(cause), parts.bullets(lines)) for cause, lines in folds(content.ledger)
        ]
        subjects = "; ".join(dict.fromkeys(standing(records, file) for file in records.run.claims or []))
        rule = parts.paragraph(CLAIMS.format(subjects, here))
        heading = HEADING.format("Not tested") if untested else Markup("")
        yield folded("claims", "Claims", rule, *judged, heading, *untested)


def provenance(records: Records) -> shell.Groups:
    """Return groups of name and value that tell how to repeat the run."""
    run = records.run
    phases = [(f"{name} (wall)", wording.duration(seconds)) for name, seconds in run.phases.items()]
    sets = []
    for scene in run.scenes:
        split = ", ".join(f"{many} {split}" for split, many in scene.views.items() if many)
        rendered = [f"{name} {value}" for name, value in settings_rows(scene.rendered)]
        corners = " to ".join(f"({', '.join(f'{x:.3g}' for x in corner)})" for corner in scene.bounds)
        hull = "" if scene.hull_share is None else f", of which the silhouettes leave {scene.hull_share:.0%}"
        known = [scene.view_set, split, f"box {corners}{hull}", scene.seen, *rendered]
        sets.append((scene.name, "; ".join(filter(None, known))))
    groups = [
        ("Run", [("command", run.command), *phases, ("digest of the records", records_digest(records))]),
        ("Settings", settings_rows(run.settings)),
        ("Machine and versions", settings_rows(run.provenance)),
        ("View sets", sets),
    ]
    return [(title, [(name, value) for name, value in rows if value]) for title, rows in groups if rows]


def expected_cells(run: RunRecord) -> int:
    """Return the number of planned cells of the compared methods; older records list only what has begun."""
    counts = []
    for name, begun in (("scenes", len(run.scenes)), ("methods", len(run.methods)), ("seeds", len(run.seeds))):
        planned = run.settings.get(name)
        counts.append(len(planned) if isinstance(planned, list) else begun)
    return math.prod(counts)


def version(records: Records) -> str:
    """Return a word that differs between the pages of a run as it grows."""
    return f"{records_digest(records)[:16]}{'-finished' if records.run.finished else ''}"


def write_page(
    records: Records, path: Path, shelves: ShelfRecords = NO_SHELVES, shown: dict[str, ShelfShown] | None = None
) -> None:
    """Write the pictures, then the page, then the script that an open page of an unfinished run asks for the newest
    version, each atomically. `shown`: shelf → its studies, if they were already laid out.
    """
    pixels = picture_data(records)
    files = pixels.files if pixels else {}
    write_files(files, path.parent)
    write_atomically(path, _page(records, shelves, pixels, shown or {}), fsync=False)
    newest = path.parent / VERSION_FILE
    if not records.run.finished or newest.exists():  # a finished run tells the open page of its beginning
        write_atomically(newest, f"reportVersion({as_json(version(records))});\n", fsync=False)
    remove_others(files, path.parent)
