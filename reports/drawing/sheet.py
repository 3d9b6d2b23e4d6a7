"""Panels of a page side by side in one figure, to be saved as a picture."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from reports.drawing.figure import STYLE, paint
from reports.drawing.images import save
from reports.drawing.palette import INK, MUTED, Pen
from reports.drawing.traces import Panel

Key = dict[str, dict[str, Any]]
"""The name of each line → how it is plotted."""
Drawing = tuple[Panel, Key]
CROSS: dict[str, Any] = {"marker": "x", "linestyle": " ", "color": MUTED.light, "markersize": 7}


def key_of(panel: Panel) -> Key:
    """Return the key of a panel whose traces are labelled with what they show."""
    styles = {"line": "-", "range": "-", "floor": "--", "mark": " ", "cross": " "}
    key: Key = {}
    for trace in panel.traces:
        if trace.kind in styles:
            face = "white" if trace.hollow else trace.colour
            look = {"color": trace.colour, "linewidth": trace.width, "markerfacecolor": face, "markersize": trace.size}
            marker = {"mark": trace.marker, "cross": "x"}.get(trace.kind)
            key[trace.label] = look | {"linestyle": styles[trace.kind], "marker": marker}
    return key


def key_of_pens(pens: dict[str, Pen]) -> Key:
    return {
        name: {
            "marker": pen.marker,
            "linestyle": (0, pen.dash) if pen.dash else "-",
            "color": pen.colour.light,
            "markerfacecolor": "white" if pen.hollow else pen.colour.light,
            "markersize": 4.6,
        }
        for name, pen in pens.items()
    }


def save_sheet(path: Path, drawings: Sequence[Drawing], across: int, size: tuple[float, float] | None = None) -> None:
    """Save panels side by side, if there are any, each of `size` in inches or of its size on the page."""
    if drawings:
        with matplotlib.rc_context(STYLE):
            save(sheet(drawings, across, size), path)


def sheet(drawings: Sequence[Drawing], across: int, size: tuple[float, float] | None = None) -> Figure:
    """Draw panels side by side. A label that all axes share, and a key that all panels share, are drawn once."""
    panels, keys = [panel for panel, _ in drawings], [key for _, key in drawings]
    across = min(across, len(panels))
    down = math.ceil(len(panels) / across)
    wide, high = size or (max(panel.size[0] for panel in panels), max(panel.size[1] for panel in panels))
    labels = [{getattr(panel, name) for panel in panels} for name in ("x_label", "y_label")]
    x_label, y_label = (words.pop() if len(panels) > 1 and len(words) == 1 else "" for words in labels)
    one_key = all(key == keys[0] for key in keys)
    figure = Figure(figsize=(wide * across, (high + (0.3 if one_key else 0.8)) * down + 0.3), layout="constrained")
    grid = figure.subplots(down, across, squeeze=False)
    for axes in grid.flat[len(panels) :]:
        axes.set_visible(False)
    for axes, (panel, key) in zip(grid.flat, drawings, strict=False):
        own = replace(
            panel, x_label="" if x_label else panel.x_label, y_label="" if y_label else panel.y_label, ends=()
        )
        paint(axes, own)
        axes.set_title(panel.title, fontsize=9, loc="left", color=INK.light)
        if not one_key:
            handles = [axes.plot([], [], label=name, **style)[0] for name, style in key.items()]
            axes.legend(
                handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False, fontsize=6.5
            )
    figure.supxlabel(x_label, fontsize=9, color=MUTED.light)
    figure.supylabel(y_label, fontsize=9, color=MUTED.light)
    if one_key and keys[0]:
        handles = [grid.flat[0].plot([], [], label=name, **style)[0] for name, style in keys[0].items()]
        ncols = min(len(handles), max(2, round(1.3 * across)))
        figure.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 0.99), ncols=ncols, frameon=False)
    return figure
