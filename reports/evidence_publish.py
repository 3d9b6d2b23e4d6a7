"""What a README shows of the studies: evidence.json, the effects of the parts, and how φ fares over resolution."""

from dataclasses import replace
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.evidence_record import EVIDENCE_FILE, Effect, EvidenceRecord, write_evidence
from reports import palette
from reports.effects_plot import BUDGETS, Axis, axis_of, metric_of
from reports.evidence_view import of_interest
from reports.figure import STYLE
from reports.inline_png import save
from reports.series_charts import of_item
from reports.stability_publish import chart, first_chart

EFFECTS, BANDWIDTH = "evidence_effects.png", "bandwidth.png"
LARGEST = 500_000
"""Bytes of a published record; a longer one is left without its lines."""


def write_published_evidence(record: EvidenceRecord, folder: Path) -> list[Path]:
    """The record, and a PNG for each of what there is to draw; gives what was written."""
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / EVIDENCE_FILE]
    write_evidence(written[0], record)
    if written[0].stat().st_size > LARGEST:
        write_evidence(written[0], replace(record, studies=[replace(one, series=[]) for one in record.studies]))
    with matplotlib.rc_context(STYLE):
        for name, figure in ((EFFECTS, effects_figure(record)), (BANDWIDTH, bandwidth_figure(record))):
            if figure is not None:
                save(figure, folder / name)
                written.append(folder / name)
    return written


def effects_figure(record: EvidenceRecord) -> Figure | None:
    """What each part does to PSNR over all scenes, at equal steps and at equal time, side by side."""
    study = record.study("factorial")
    effects = [one for one in study.effects if (one.metric, one.scene) == ("psnr", "all")] if study else []
    effects = [one for one in effects if not one.against and one.difference is not None]
    budgets = [budget for budget in BUDGETS if any(one.budget == budget for one in effects)]
    if not budgets:
        return None
    names = list(dict.fromkeys(map(_name, effects)))
    figure = Figure(figsize=(2.2 + 3.2 * len(budgets), 0.9 + 0.27 * len(names)), layout="constrained")
    band = of_interest(record).get("psnr", 0.0)
    axis = axis_of(effects, band)
    every = figure.subplots(1, len(budgets), squeeze=False, sharey=True)[0]
    for axes, budget in zip(every, budgets, strict=True):
        axes.axvspan(-band, band, color=palette.RULE.light, lw=0)
        axes.axvline(0.0, color=palette.INK.light, lw=0.8)
        for one in effects:
            if one.budget == budget:
                _row(axes, one, axis, names.index(_name(one)))
        axes.set_xlim(axis.low, axis.high)
        axes.set_title(BUDGETS[budget], fontsize=9, loc="left", color=palette.INK.light)
        axes.set_xlabel(f"difference in test {metric_of('psnr').label} (dB)")
        axes.grid(axis="y", visible=False)
    every[0].set_ylim(len(names) - 0.5, -0.6)
    every[0].set_yticks(range(len(names)), names, color=palette.INK.light)
    figure.supxlabel(
        "all scenes; dark bar: 95 % interval of one effect alone; pale: of all effects at once, from which the verdict "
        "is taken; arrow: it goes on\nfilled dot: settled; grey band: too small to matter",
        fontsize=7.5,
        color=palette.MUTED.light,
    )
    return figure


def _name(one: Effect) -> str:
    """With its note, where effects of one name differ by it."""
    return f"{one.name} ({one.note})" if one.note else one.name


def _row(axes: Axes, one: Effect, axis: Axis, place: int) -> None:
    """The pale bar is the interval that the verdict is taken from, the dark one that of this effect alone."""
    colour = palette.KNOWN["nerf"].light
    settled = one.verdict in ("better", "worse")
    for pair, width, alpha in ((one.simultaneous, 6.0, 0.3), (one.interval, 1.8, 1.0)):
        if pair is not None:
            axes.hlines(place, max(pair[0], axis.low), min(pair[1], axis.high), color=colour, lw=width, alpha=alpha)
            for at, beyond, head in ((axis.low, pair[0] < axis.low, "<"), (axis.high, pair[1] > axis.high, ">")):
                if beyond:
                    axes.plot([at], [place], head, ms=5, color=colour, clip_on=False)
    axes.plot([one.difference or 0.0], [place], "o", ms=5.5, mec=colour, mfc=colour if settled else "white", mew=1.4)


def bandwidth_figure(record: EvidenceRecord) -> Figure | None:
    """The first chart of the study: how far φ and its controls are from NeRF, over resolution."""
    study = record.study("bandwidth")
    found = first_chart(of_item(study.series, 0)) if study else None
    if found is None:
        return None
    figure = Figure(figsize=(5.4, 4.2), layout="constrained")
    chart(figure.add_subplot(), *found)
    return figure
