"""The figures of the studies that the README shows: their records, each with panels of its page that show most."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import matplotlib
import msgspec
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.records.serving_record import SERVING_FILE, AttentionRecord, Measure, ServingRecord, write_serving
from harness.records.study import SHELVES, Picture, Series, Studies, write_studies
from reports.drawing import palette
from reports.drawing.figure import STYLE, paint
from reports.drawing.images import save
from reports.drawing.palette import Pen
from reports.drawing.series_charts import panel, panels_of, pens_in, with_points
from reports.drawing.sheet import Drawing, key_of, key_of_pens, sheet
from reports.drawing.traces import Panel
from reports.studies.forest import forests
from reports.studies.matrix import miniature
from reports.studies.serving_cache import latency_panels, pens_of_methods
from reports.studies.serving_curves import PENS, anytime_panels
from reports.studies.serving_said import MAPS
from reports.studies.study_page import of_interest

LARGEST = 1_000_000
"""The largest size in bytes of a published record; a longer one is left without its lines."""
CHAPTERS_DRAWN = (1, 2, 3, 9)
"""Rounding, truncation, gradients, ladders: the first chart of each is drawn."""


def write_published(record: Studies, folder: Path) -> list[Path]:
    """Write the record without its pictures, and a PNG for each of what there is to draw; returns the written paths."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / SHELVES[record.shelf]
    record = without(record, Picture)
    write_studies(path, record)
    if path.stat().st_size > LARGEST:
        write_studies(path, without(record, Series))
    written = [path]
    for name, (choose, across) in PICTURES[record.shelf].items():
        drawings = choose(record)
        if drawings:
            with matplotlib.rc_context(STYLE):
                save(sheet(drawings, across), folder / name)
            written.append(folder / name)
    return written


def without(record: Studies, kind: type) -> Studies:
    """Return the record without its findings of one kind."""
    kept = [
        msgspec.structs.replace(study, findings=[one for one in study.findings if not isinstance(one, kind)])
        for study in record.studies
    ]
    return msgspec.structs.replace(record, studies=kept)


def charts_of(series: list[Series]) -> list[Drawing]:
    drawn = with_points(series)
    pens = pens_in(drawn)
    return [
        (panel(title, lines, pens), key_of_pens({one.name: pens[one.name] for one in lines}))
        for title, lines in panels_of(drawn)
    ]


def charts_of_study(record: Studies, name: str) -> list[Drawing]:
    study = record.study(name)
    return charts_of(study.series) if study else []


def first_charts(record: Studies) -> list[Drawing]:
    """Return the first chart of each chosen chapter."""
    series = [one for study in record.studies for one in study.series]
    return [
        drawing for item in CHAPTERS_DRAWN for drawing in charts_of([one for one in series if one.item == item])[:1]
    ]


def effects_of_parts(record: Studies) -> list[Drawing]:
    """Return what each part does to PSNR over all scenes, at equal steps and at equal time."""
    study = record.study("factorial")
    effects = [one for one in study.effects if not one.against] if study else []
    panels = forests(effects, of_interest(record))
    return [(panels[key], key_of(panels[key])) for key in panels if (key[0], key[2]) == ("psnr", "all")]


def matrix_in_miniature(record: Studies) -> list[Drawing]:
    drawn = miniature(record)
    return [(drawn, key_of(drawn))] if drawn else []


PICTURES: dict[str, dict[str, tuple[Callable[[Studies], list[Drawing]], int]]] = {
    "evidence": {
        "evidence_effects.png": (effects_of_parts, 1),
        "bandwidth.png": (lambda record: charts_of_study(record, "bandwidth")[:1], 1),
    },
    "stability": {"stability.png": (matrix_in_miniature, 1), "stability_curves.png": (first_charts, 2)},
    "speed": {"speed.png": (lambda record: charts_of_study(record, "3"), 3)},
}
"""Shelf → file → the panels of its page that are saved in it, and how many of them side by side."""


PLOT = "serving.png"
MEASURES_DRAWN: dict[Measure, str] = {"whole": "whole picture", "hardest": "its hardest quarter"}


def write_published_serving(record: ServingRecord, methods: list[str], folder: Path) -> list[Path]:
    """Write the record without pictures and curves (summary.json holds those), and a plot if there is something to
    draw.

    Returns the written paths.
    """
    folder.mkdir(parents=True, exist_ok=True)
    attention = record.attention and replace(record.attention, frames=[], curves=[])
    write_serving(folder, replace(record, attention=attention))
    written = [folder / SERVING_FILE]
    with matplotlib.rc_context(STYLE):
        figure = serving_figure(record, methods)
        if figure is not None:
            save(figure, folder / PLOT)
            written.append(folder / PLOT)
    return written


def serving_figure(record: ServingRecord, methods: list[str]) -> Figure | None:
    """Draw latencies on the first scene, and error over time on the first scene, by the first map, attended and
    complete.
    """
    drawn: list[tuple[str, Panel, dict[str, Pen]]] = []
    if record.cache is not None and record.cache.latencies:
        pens = pens_of_methods(methods, [one.method for one in record.cache.latencies])
        pens = {name: pens[name] for name in dict.fromkeys(one.method for one in record.cache.latencies)}
        panel = latency_panels(record.cache, pens)[0]
        drawn.append((f"time of a view, {panel.title} (grey: target)", panel, pens))
    if record.attention is not None and record.attention.curves:
        drawn += _curves(record.attention)
    if not drawn:
        return None
    figure = Figure(figsize=(3.9 * len(drawn), 3.5), layout="constrained")
    for axes, (title, panel, pens) in zip(figure.subplots(1, len(drawn), squeeze=False)[0], drawn, strict=True):
        _chart(axes, title, panel, pens)
    return figure


def _curves(record: AttentionRecord) -> list[tuple[str, Panel, dict[str, Pen]]]:
    first = record.curves[0]
    chosen = [one for one in record.curves
              if (one.scene, one.method, one.attention) == (first.scene, first.method, first.attention)]  # fmt: skip
    pens = {one.order: PENS[one.order] for one in chosen}
    about = f"{first.scene}, {MAPS.get(first.attention, first.attention)}"
    return [
        (
            f"{what}, {about}",
            anytime_panels(chosen[::-1], record.reaching, measure)[0],
            {str(name): pen for name, pen in pens.items()},
        )
        for measure, what in MEASURES_DRAWN.items()
    ]


def _chart(axes: Axes, title: str, panel: Panel, pens: dict[str, Pen]) -> None:
    paint(axes, panel)
    axes.set_title(title, fontsize=9, loc="left", color=palette.INK.light)
    handles = [axes.plot([], [], label=name, **style)[0] for name, style in key_of_pens(pens).items()]
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False, fontsize=6.5)
