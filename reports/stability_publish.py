"""What a README shows of a stability run: stability.json, the matrix in miniature, and the curves that tell most."""

import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.chart_record import Series
from harness.stability_record import STABILITY_FILE, CaseRecord, StabilityRecord, write_stability
from reports import palette
from reports.figure import STYLE, paint
from reports.inline_png import save
from reports.pens import Pen
from reports.series_charts import of_item, panel, panels_of, pens_in
from reports.stability_matrix import cell
from reports.stability_wording import LEGEND, MARKS, OWNERS, Tone, tone_of

MATRIX, CURVES = "stability.png", "stability_curves.png"
CHAPTERS_DRAWN = (1, 2, 3, 9)
"""Rounding, truncation, gradients, ladders: the first chart of each."""
INKS: dict[Tone, str] = {
    "passes": "#00654c",
    "fails": "#a8330a",
    "property": "#7a3d8c",
    "unsettled": palette.MUTED.light,
    "absent": palette.MUTED.light,
    "spared": palette.MUTED.light,
}
GROUNDS: dict[Tone, str] = {"passes": "#e4f2ee", "fails": "#f7b8a0", "property": "#ecd9f1"}
TITLE_WIDTH = 14.0
"""Of the column of titles, in squares."""
LEAST_WIDTH = 9.0
"""Of the squares of one owner: its name stands above them."""
LEGEND_WIDTH = 40.0


def write_published_stability(record: StabilityRecord, folder: Path) -> list[Path]:
    """The record without its pictures, which stay behind, and a PNG for each of what there is to draw."""
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / STABILITY_FILE]
    write_stability(written[0], replace(record, cases=[replace(case, pictures=[]) for case in record.cases]))
    with matplotlib.rc_context(STYLE):
        for name, figure in ((MATRIX, miniature(record)), (CURVES, curves(record))):
            if figure is not None:
                save(figure, folder / name)
                written.append(folder / name)
    return written


def miniature(record: StabilityRecord) -> Figure | None:
    """A row a case; a square a subject, under whose form it is, marked by what became of it."""
    cases = [case for case in record.cases if case.outcomes]
    if not cases:
        return None
    widths = {whose: max(len(squares(case, whose)) for case in cases) for whose in OWNERS}
    owners = [whose for whose in OWNERS if widths[whose]]
    wide = {whose: max(widths[whose] + 1.0, LEAST_WIDTH) for whose in owners}
    starts = {whose: TITLE_WIDTH + sum(wide[one] for one in owners[:place]) for place, whose in enumerate(owners)}
    width = max(TITLE_WIDTH + sum(wide.values()), LEGEND_WIDTH)
    figure = Figure(figsize=(0.21 * width, 0.21 * (len(cases) + 3)))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    axes.set_xlim(0, width)
    axes.set_ylim(len(cases) + 1.6, -1.4)
    for whose in owners:
        axes.text(starts[whose], -0.35, OWNERS[whose].removeprefix("the "), fontsize=7.5, color=palette.MUTED.light)
    for line, case in enumerate(cases):
        axes.text(0, line + 0.5, case.info.id, fontsize=8, weight="bold", va="center", color=palette.INK.light)
        axes.text(1.8, line + 0.5, case.info.title, fontsize=8, va="center", color=palette.INK.light)
        for whose in owners:
            for place, tone in enumerate(squares(case, whose)):
                _square(axes, starts[whose] + place, line, tone)
    _legend(axes, len(cases) + 0.6, {tone_of(one) for one in record.outcomes()})
    return figure


def squares(case: CaseRecord, whose: str) -> list[Tone]:
    """What became of each subject of one owner."""
    chosen = [one for one in case.outcomes if one.whose == whose]
    subjects = dict.fromkeys(one.subject for one in chosen)
    return [cell([one for one in chosen if one.subject == subject]).tone for subject in subjects]


def _square(axes: Axes, x: float, y: float, tone: Tone) -> None:
    axes.add_patch(matplotlib.patches.Rectangle((x, y + 0.06), 0.88, 0.88, color=GROUNDS.get(tone, "#f3f3f4"), lw=0))
    axes.text(x + 0.44, y + 0.52, MARKS[tone], fontsize=7.5, ha="center", va="center", color=INKS[tone])


def _legend(axes: Axes, y: float, tones: set[Tone]) -> None:
    short = {"passes": "passes", "fails": "fails, and is ours", "property": "fails: a property of that form"}
    x = 0.0
    for tone, words in LEGEND:
        if tone in tones:
            said = short.get(tone, words)
            _square(axes, x, y, tone)
            axes.text(x + 1.1, y + 0.5, said, fontsize=7.5, va="center", color=palette.MUTED.light)
            x += 2.4 + 0.31 * len(said)


def curves(record: StabilityRecord) -> Figure | None:
    """The first chart of each chosen chapter, side by side."""
    series = [one for case in record.cases for one in case.series]
    chosen = [found for item in CHAPTERS_DRAWN if (found := first_chart(of_item(series, item)))]
    if not chosen:
        return None
    across = min(2, len(chosen))
    down = math.ceil(len(chosen) / across)
    figure = Figure(figsize=(5.4 * across, 4.6 * down), layout="constrained")
    grid = figure.subplots(down, across, squeeze=False)
    for axes in list(grid.flat)[len(chosen) :]:
        axes.set_visible(False)
    for axes, (title, group, pens) in zip(grid.flat, chosen, strict=False):
        chart(axes, title, group, pens)
    return figure


def chart(axes: Axes, title: str, group: list[Series], pens: dict[str, Pen]) -> None:
    """One chart as the page shows it, with its title above and its key below."""
    paint(axes, panel(title, group, pens))
    axes.set_title(title, fontsize=9, loc="left", color=palette.INK.light)
    keys(axes, dict.fromkeys(one.name for one in group), pens)


def first_chart(series: list[Series]) -> tuple[str, list[Series], dict[str, Pen]] | None:
    """Title, lines and pens of the first chart of a chapter, where it has one."""
    charts = panels_of(series)
    return (*charts[0], pens_in(series)) if charts else None


def keys(axes: Axes, names: Iterable[str], pens: dict[str, Pen]) -> None:
    """What the lines of a chart are, below it."""
    handles = [
        axes.plot(
            [], [], label=name, color=pens[name].colour.light, marker=pens[name].marker, markersize=4.6,
            linestyle=(0, pens[name].dash) if pens[name].dash else "-",
            markerfacecolor="white" if pens[name].hollow else pens[name].colour.light,
        )[0]
        for name in names
    ]  # fmt: skip
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False, fontsize=6.5)
