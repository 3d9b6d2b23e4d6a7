"""What a README shows of serving: serving.json, and how long a view takes beside how it gets better meanwhile."""

from dataclasses import replace
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.serving_record import SERVING_FILE, AttentionRecord, Measure, ServingRecord, write_serving
from reports import palette
from reports.figure import STYLE, paint
from reports.inline_png import save
from reports.pens import Pen
from reports.serving_cache import latency_panels, pens_of_methods
from reports.serving_curves import PENS, anytime_panels
from reports.serving_wording import MAPS
from reports.stability_publish import keys
from reports.trace_data import Panel

PLOT = "serving.png"
MEASURES_DRAWN: dict[Measure, str] = {"whole": "whole picture", "hardest": "its hardest quarter"}


def write_published_serving(record: ServingRecord, methods: list[str], folder: Path) -> list[Path]:
    """The record without pictures and curves (summary.json holds those), and a plot where there is something to draw.

    Gives what was written.
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
    """Latencies on the first scene; error over time on the first scene, by the first map, attended and whole."""
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
    keys(axes, pens, pens)
