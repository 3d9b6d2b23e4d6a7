"""summary.json, which holds every number of the page for scripts, and small PNG plots for a README."""

import shlex
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.image
from matplotlib.figure import Figure
from msgspec import structs

from harness.records.cells import CellRecord
from harness.records.json_record import finite_or_none, plain, write_json
from harness.records.metric_table import METRICS
from harness.verdicts.last_doubling import last_doublings
from reports.claims.claim_list import claims
from reports.claims.estimands import failures_of
from reports.claims.headline import headline
from reports.claims.ledger import not_tested
from reports.claims.psnr_table import tone_of
from reports.data.load import Records
from reports.data.saved_pictures import kept
from reports.data.studies_load import NO_SHELVES, ShelfRecords
from reports.data.table import cells_frame
from reports.drawing.figure import STYLE
from reports.drawing.images import save
from reports.drawing.palette import INK, MUTED, colours_of
from reports.drawing.sheet import CROSS, Key, save_sheet
from reports.drawing.traces import Kind, Panel, Trace
from reports.run.curves import EVERYWHERE, diagrams
from reports.run.pictures import as_picture, first_view, last_render, seed_shown
from reports.run.saving.archive import write_archive

SCHEMA = 1
ABOUT_SCENE = ("width", "height", "views", "psnr_ceiling", "psnr_floor")
CLAIM = (
    *("id", "source", "printed", "measured", "interval", "scale", "verdict"),
    *("statement", "kind", "unit", "how", "note"),
)


def summary(records: Records, shelves: ShelfRecords = NO_SHELVES) -> dict[str, object]:
    """Return JSON-ready data: a non-finite number is None. `serving` is None if it was not measured."""
    run, ledger = records.run, claims(records, shelves)
    return {
        "schema": SCHEMA,
        "profile": run.profile,
        "finished": run.finished,
        "damaged": records.left_out,
        "headline": headline(records).title,
        "command": run.command,
        "seeds": run.seeds,
        "methods": run.methods,
        "scenes": [
            {"scene": scene.name, **{name: getattr(scene, name) for name in ABOUT_SCENE}} for scene in run.scenes
        ],
        "last_doubling": [asdict(row) for row in last_doublings(records.cells, records.methods)],
        "cells": [_cell(cell) for cell in records.every_cell],
        "comparisons": [plain(comparison) for comparison in (*records.comparisons, *records.extra_comparisons)],
        "failures": asdict(failures_of(records)),
        "claims": [{name: getattr(claim, name) for name in CLAIM} for claim in ledger],
        "serving": [{"study": study.info.id, **plain(check)} for study, check in shelves.serving.checks()]
        if shelves.serving
        else None,
        "left_out": [{"scene": scene.name, **plain(omission)} for scene in run.scenes for omission in scene.left_out],
        "deviations": run.deviations,
        "not_tested": not_tested(run.not_tested, ledger),
        "phases": run.phases,
        "settings": run.settings,
        "provenance": run.provenance,
    }


def _cell(cell: CellRecord) -> dict[str, object]:
    scores = dict.fromkeys([*METRICS, "psnr_train", "psnr_ceiling", *cell.scores])
    counts = ("seconds", "core_seconds", "network_evaluations")
    curve: dict[str, object] = {"steps": [point.step for point in cell.curve]}
    curve |= {name: [getattr(point, name) for point in cell.curve] for name in counts}
    curve |= {name: [finite_or_none(getattr(point, name)) for point in cell.curve] for name in METRICS}
    own = ("scene", "method", "seed", "status", "reason", "steps", "train_seconds", "train_core_seconds", "costs")
    return {
        **{name: getattr(cell, name) for name in own},
        **{name: finite_or_none(cell.scores.get(name)) for name in scores},
        "curve": curve,
        **{name: getattr(cell, name) for name in ("parameters", "properties", "warnings")},
    }


def write_summary(records: Records, path: Path, shelves: ShelfRecords = NO_SHELVES) -> None:
    write_json(path, summary(records, shelves))


def write_published(records: Records, folder: Path, shelves: ShelfRecords = NO_SHELVES) -> None:
    """Write summary.json, run.zip (`reports.run.saving.archive`) and, if they can be drawn, psnr.png,
    error_vs_time.png, work_precision.png and views.png. Command and settings of the run keep only the last name of
    each absolute path: its folders are of one machine.
    """
    run = records.run
    hidden = structs.replace(run, command=without_folders(run.command), settings=_last_names(run.settings))
    records = replace(records, run=hidden)
    folder.mkdir(parents=True, exist_ok=True)
    write_summary(records, folder / "summary.json", shelves)
    write_archive(records, folder / "run.zip")
    over_time = [diagram for diagram in diagrams(records) if diagram.cost.name in ("seconds", "core_seconds")]
    errors = [panel for diagram in over_time if diagram.name == "rmse_linear-seconds" for panel in diagram.panels]
    # wall time and processor time, side by side if both are known
    everywhere = [replace(diagram.panels[0], title=diagram.measure.label) for diagram in over_time]
    colours = colours_of(records.methods)
    key: Key = {name: {"marker": "o", "linestyle": " ", "color": colours[name].light} for name in records.methods}
    key |= {"a seed that did not finish": CROSS} if records.failed else {}
    for name, drawings, across, size in (
        ("psnr", [(psnr_dots(records), key)], 1, None),
        ("error_vs_time", [(panel, key) for panel in errors if panel.title != EVERYWHERE], 4, (2.5, 2.1)),
        ("work_precision", [(panel, key) for panel in everywhere], 2, (3.4, 2.9)),
    ):
        save_sheet(folder / f"{name}.png", drawings, across, size)
    with matplotlib.rc_context(STYLE):
        if (views := contact(records)) is not None:
            save(views, folder / "views.png")


def without_folders(command: str) -> str:
    """Return a shell's command with each absolute path cut to its last name."""
    words = []
    for word in shlex.split(command):
        option, sign, value = word.partition("=") if word.startswith("-") else ("", "", word)
        words.append(f"{option}{sign}{_last_names(value)}")
    return shlex.join(words)


def _last_names(value: Any) -> Any:
    """Return nested settings with each absolute path cut to its last name."""
    if isinstance(value, dict):
        return {name: _last_names(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_last_names(inner) for inner in value]
    return Path(value).name if isinstance(value, str) and Path(value).is_absolute() else value


def psnr_dots(records: Records) -> Panel:
    frame = cells_frame(records)
    done = frame[(frame["status"] == "done") & frame["psnr"].notna()]
    lowest = float(done["psnr"].min()) if len(done) else 0.0
    traces = []
    for order, (method, colour) in enumerate(colours_of(records.methods).items()):
        dots, means, lost = [], [], []
        for row, scene in enumerate(records.scenes):
            at = row + 0.62 * ((order + 0.5) / len(records.methods) - 0.5)
            scores = done[(done["scene"] == scene) & (done["method"] == method)]["psnr"]
            dots += [(float(score), at) for score in scores]
            means += [(float(scores.mean()), at)] if len(scores) else []
            lost += [(lowest - 1, at)] if tone_of(records.cells_of(scene, method)) == "failed" else []
        kinds: list[tuple[Kind, list[tuple[float, float]], str]]
        kinds = [("dots", dots, "o"), ("mark", means, "|"), ("cross", lost, "x")]
        for kind, points, marker in kinds:
            if points:
                x, y = zip(*points, strict=True)
                traces.append(Trace(method, colour.light, kind, x, y, marker=marker, hollow=False, size=11))
    rows, title = tuple(records.scenes), "Test PSNR of every seed; bars are means"
    return Panel(title, "test PSNR (dB)", "", tuple(traces), title, rows=rows, size=(5.4, 0.7 + 0.45 * len(rows)))


def contact(records: Records) -> Figure | None:
    rows = []
    for scene in records.scenes:
        seed = seed_shown(records, scene)
        saved = kept(records, scene, () if seed is None else (seed,))
        view = first_view(saved)
        if view is None:
            continue
        cells = {cell.method: cell for cell in records.cells if (cell.scene, cell.seed) == (scene, seed)}
        renders = [last_render(saved, cells[method], view) if method in cells else None for method in records.methods]
        truth = saved.truth.get(view)
        displayed = [truth.display if truth else None, *(render.colour if render else None for render in renders)]
        rows.append((scene, [None if colour is None else as_picture(colour) for colour in displayed]))
    if not rows:
        return None
    names = ["ground truth", *records.methods]
    figure = Figure(figsize=(1.5 * len(rows), 1.55 * len(names)), layout="constrained")
    grid = figure.subplots(len(names), len(rows), squeeze=False)
    for column, (scene, pictures) in enumerate(rows):
        for line, picture in enumerate(pictures):
            axes = grid[line][column]
            axes.set_xticks([])
            axes.set_yticks([])
            axes.spines[:].set_visible(False)
            axes.grid(visible=False)
            if picture is None:
                words = "not available" if names[line] in records.not_available else "did not finish"
                axes.text(0.5, 0.5, words, ha="center", va="center", color=MUTED.light, transform=axes.transAxes)
            else:
                axes.imshow(picture, interpolation="nearest")
            if line == 0:
                axes.set_title(scene, fontsize=9, color=INK.light)
            if column == 0:
                axes.set_ylabel(names[line], fontsize=9, color=INK.light)
    return figure
