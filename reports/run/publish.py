"""summary.json, every number of the page for those who script against it; and small PNG plots for a README."""

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.image
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.records.cells import CellRecord
from harness.records.json_record import finite_or_none, plain, write_json
from harness.records.metric_table import METRICS
from harness.records.serving_record import CacheRecord, ServingRecord
from reports.claims.claim_list import claims
from reports.claims.estimands import found_failures
from reports.claims.headline import headline
from reports.claims.ledger import not_tested
from reports.claims.psnr_table import tone_of
from reports.data.beside import ALONE, Beside
from reports.data.kept_pictures import kept
from reports.data.load import Records
from reports.data.table import cells_frame
from reports.drawing.figure import STYLE, paint
from reports.drawing.images import save
from reports.drawing.palette import INK, MUTED, colours_of
from reports.drawing.traces import Panel
from reports.run.density import ladder_panel
from reports.run.pictures import as_picture, first_view, last_render, seed_shown
from reports.run.work_precision import EVERYWHERE, diagrams

SCHEMA = 1


def summary(records: Records, beside: Beside = ALONE) -> dict[str, Any]:
    """Return plain data, JSON-ready: a number that is not finite is None and the cell's status says why.

    `cache` and `attention` are None if they were not measured.
    """
    run, found = records.run, claims(records, beside)
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
            {
                "scene": scene.name,
                "width": scene.width,
                "height": scene.height,
                "views": scene.views,
                "psnr_ceiling": scene.psnr_ceiling,
                "psnr_floor": scene.psnr_floor,
            }
            for scene in run.scenes
        ],
        "cells": [_cell(cell) for cell in (*records.cells, *records.extra_cells)],
        "comparisons": [plain(one) for one in (*records.comparisons, *records.extra_comparisons)],
        "failures": asdict(found_failures(records)),
        "claims": [_claim(one.__dict__) for one in found],
        "cache": _cache(beside.serving.cache) if beside.serving and beside.serving.cache else None,
        "attention": _attention(beside.serving) if beside.serving else None,
        "left_out": [{"scene": scene.name, **plain(one)} for scene in run.scenes for one in scene.left_out],
        "deviations": run.deviations,
        "not_tested": not_tested(run.not_tested, found),
        "phases": run.phases,
        "settings": run.settings,
        "provenance": run.provenance,
    }


def _cell(cell: CellRecord) -> dict[str, Any]:
    scores = [*METRICS, "psnr_train", "psnr_ceiling", *(name for name in cell.scores if name not in METRICS)]
    return {
        "scene": cell.scene,
        "method": cell.method,
        "seed": cell.seed,
        "status": cell.status,
        "reason": cell.reason,
        "steps": cell.steps,
        "train_seconds": cell.train_seconds,
        **{name: finite_or_none(cell.scores.get(name)) for name in dict.fromkeys(scores)},
        "curve": {
            "steps": [point.step for point in cell.curve],
            "seconds": [point.seconds for point in cell.curve],
            "network_evaluations": [point.network_evaluations for point in cell.curve],
            "psnr": [finite_or_none(point.psnr) for point in cell.curve],
            "rmse_linear": [finite_or_none(point.rmse_linear) for point in cell.curve],
        },
        "parameters": cell.parameters,
        "properties": cell.properties,
        "warnings": cell.warnings,
    }


def _cache(record: CacheRecord) -> dict[str, Any]:
    paths = [{**asdict(one), "hit_rate": one.hit_rate} for one in record.paths]
    return {**asdict(record), "paths": paths}


def _attention(record: ServingRecord) -> dict[str, Any] | None:
    """Return attention with the viewer's first frame, which refines by attention."""
    if record.attention is None:
        return None
    first = asdict(record.first_frame) if record.first_frame else None
    curves = [
        {
            name: [_short(one) for one in value] if isinstance(value, list) else value
            for name, value in asdict(one).items()
        }
        for one in record.attention.curves
    ]
    return {**asdict(record.attention), "curves": curves, "first_frame": first}


def _short(value: float) -> float:
    """Round to five digits: more than such a figure holds, and half as long to write."""
    return float(f"{value:.5g}")


def _claim(claim: dict[str, Any]) -> dict[str, Any]:
    judged = ("id", "source", "printed", "measured", "interval", "scale", "verdict")
    explained = ("statement", "kind", "unit", "how", "note")
    return {name: claim[name] for name in (*judged, *explained)}


def write_summary(records: Records, path: Path, beside: Beside = ALONE) -> None:
    """Write atomically; NaN and Infinity are refused."""
    write_json(path, summary(records, beside))


def write_published(records: Records, folder: Path, beside: Beside = ALONE) -> list[Path]:
    """Write psnr.png, error_vs_time.png, work_precision.png, units.png, views.png (if they can be drawn) and
    summary.json.

    Returns the written paths.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_summary(records, folder / "summary.json", beside)
    written = [folder / "summary.json"]
    with matplotlib.rc_context(STYLE):
        figures = {
            "psnr": psnr_dots(records),
            "error_vs_time": error_against_time(records),
            "work_precision": work_precision(records),
            "views": contact(records),
            "units": ladder_of_units(records),
        }
        for name, figure in figures.items():
            if figure is not None:
                save(figure, folder / f"{name}.png")
                written.append(folder / f"{name}.png")
    return written


def psnr_dots(records: Records) -> Figure:
    """Draw a dot for each scene, method and seed; a dash at the mean; unfinished cells as a cross below."""
    frame = cells_frame(records)
    colours = colours_of(records.methods)
    figure = Figure(figsize=(max(4.0, 1.0 + 0.85 * len(records.scenes)), 3.2), layout="constrained")
    axes = figure.add_subplot()
    width = 0.62 / len(records.methods)
    done = frame[(frame["status"] == "done") & frame["psnr"].notna()]
    lowest = float(done["psnr"].min()) if len(done) else 0.0
    for place, scene in enumerate(records.scenes):
        for order, method in enumerate(records.methods):
            at = place + (order - (len(records.methods) - 1) / 2) * width
            scores = done[(done["scene"] == scene) & (done["method"] == method)]["psnr"]
            axes.plot([at] * len(scores), scores, "o", color=colours[method].light, markersize=4.5, alpha=0.75, mew=0)
            if len(scores):
                axes.plot([at - width / 3, at + width / 3], [scores.mean()] * 2, color=colours[method].light, lw=2)
            if tone_of(records.cells_of(scene, method)) == "failed":
                axes.plot([at], [lowest - 1], "x", color=colours[method].light, markersize=7, mew=2)
    axes.set_xticks(range(len(records.scenes)), records.scenes, color=INK.light)
    axes.set_ylabel("test PSNR (dB)")
    axes.grid(axis="x", visible=False)
    _legend(axes, records, "cross: a seed that did not finish" if records.failed else "")
    return figure


def error_against_time(records: Records) -> Figure | None:
    """Draw linear RMSE against training seconds, a panel per scene."""
    found = next(
        (one for one in diagrams(records) if (one.measure.name, one.cost.name) == ("rmse_linear", "seconds")), None
    )
    panels = [panel for panel in found.panels if panel.title != EVERYWHERE] if found else []
    return _side_by_side(records, [(panel.title, panel) for panel in panels], (2.5, 2.1), 4)


def work_precision(records: Records) -> Figure | None:
    """Draw every error that was measured along training against training seconds, over all scenes together."""
    found = [one for one in diagrams(records) if one.cost.name == "seconds"]
    return _side_by_side(records, [(one.measure.error, one.panels[0]) for one in found], (3.4, 2.9), 2)


def ladder_of_units(records: Records) -> Figure | None:
    """Draw test PSNR against the unit of density; None if no ladder was trained."""
    drawn = ladder_panel(records)
    if drawn is None:
        return None
    figure = Figure(figsize=(5.8, 3.2), layout="constrained")
    axes = figure.add_subplot()
    paint(axes, drawn)
    kinds = {"line": "-", "floor": "--", "cross": "x"}
    named = {trace.label: trace for trace in drawn.traces if trace.kind in kinds}
    handles = [axes.plot([], [], kinds[one.kind], color=one.colour, label=name)[0] for name, one in named.items()]
    axes.legend(handles=handles, loc="lower right", frameon=False)
    return figure


def _side_by_side(
    records: Records, panels: list[tuple[str, Panel]], size: tuple[float, float], most: int
) -> Figure | None:
    """Draw panels under titles, at most so many in a row; None if there are none."""
    if not panels:
        return None
    across = min(most, len(panels))
    down = math.ceil(len(panels) / across)
    figure = Figure(figsize=(size[0] * across + 0.4, size[1] * down + 0.6), layout="constrained")
    grid = figure.subplots(down, across, squeeze=False)
    for axes in list(grid.flat)[len(panels) :]:
        axes.set_visible(False)
    for axes, (title, panel) in zip(grid.flat, panels, strict=False):
        paint(axes, replace(panel, x_label="", y_label=""))
        axes.set_title(title, fontsize=9, loc="left", color=INK.light)
    first = panels[0][1]
    figure.supxlabel(first.x_label, fontsize=9, color=MUTED.light)
    alike = {panel.y_label for _, panel in panels} == {first.y_label}
    figure.supylabel(f"test error ({first.y_label})" if alike else "test error", fontsize=9, color=MUTED.light)
    _legend(grid.flat[0], records, "cross: a seed that did not finish" if records.failed else "")
    return figure


def contact(records: Records) -> Figure | None:
    """Draw ground truth and every method for the first stored view of each scene."""
    rows = []
    for scene in records.scenes:
        seed = seed_shown(records, scene)
        found = kept(records, scene, () if seed is None else (seed,))
        view = first_view(found)
        if view is None:
            continue
        cells = {cell.method: cell for cell in records.cells if (cell.scene, cell.seed) == (scene, seed)}
        renders = [last_render(found, cells[method], view) if method in cells else None for method in records.methods]
        truth = found.truth.get(view)
        halves = [truth.display if truth else None, *(one.colour if one else None for one in renders)]
        rows.append((scene, [None if one is None else as_picture(one) for one in halves]))
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
                said = "not available" if names[line] in records.not_available else "did not finish"
                axes.text(0.5, 0.5, said, ha="center", va="center", color=MUTED.light, transform=axes.transAxes)
            else:
                axes.imshow(picture, interpolation="nearest")
            if line == 0:
                axes.set_title(scene, fontsize=9, color=INK.light)
            if column == 0:
                axes.set_ylabel(names[line], fontsize=9, color=INK.light)
    return figure


def _legend(axes: Axes, records: Records, words: str) -> None:
    colours = colours_of(records.methods)
    handles = [axes.plot([], [], "o", color=colours[method].light, label=method)[0] for method in records.methods]
    handles += [axes.plot([], [], " ", label=words)[0]] if words else []
    figure = axes.get_figure()
    if figure is not None:
        figure.legend(
            handles=handles, loc="lower center", bbox_to_anchor=(0.5, 0.99), ncols=len(handles), frameon=False
        )
