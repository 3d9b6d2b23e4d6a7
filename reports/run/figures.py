"""Every figure of a run's page, each in one line of `FIGURES`, and the differences of the headline drawn as rows."""

from collections.abc import Callable
from typing import NamedTuple

from harness.records.verdict import phrase_with
from reports.claims.headline import tabulated
from reports.claims.psnr_table import printed_gain
from reports.data.load import Records
from reports.data.selection import behind_difference
from reports.data.wording import interval, signed
from reports.drawing.figure import with_common_limits
from reports.drawing.palette import INK, MUTED, colours_of
from reports.drawing.traces import Panel, Trace
from reports.run.curves import convergence
from reports.run.density import amplifier_over_time, density_histograms
from reports.run.time_to_target import reach_panels


def difference_panels(records: Records) -> list[Panel]:
    """Draw for the contender of the headline one panel per budget and rival, one row per scene, the mean at the
    bottom.
    """
    drawn = [
        _differences_panel(records, method, rival, budget, words)
        for method in records.contenders[:1]
        for budget, words in tabulated(records)
        for rival in records.rivals
        if rival != method
    ]
    return with_common_limits([panel for panel in drawn if panel is not None], "x")


def _differences_panel(records: Records, method: str, rival: str, budget: str, words: str) -> Panel | None:
    compared = [records.comparison(scene, method, rival, budget=budget) for scene in (*records.scenes, "all")]
    compared_rows = [comparison for comparison in compared if comparison is not None]
    rows = tuple(comparison.scene for comparison in compared_rows)
    shown = [
        (float(place), comparison, comparison.difference)
        for place, comparison in enumerate(compared_rows)
        if comparison.difference is not None
    ]
    if not shown:
        return None
    colour = colours_of(records.methods)[rival].light
    # in a family, the interval that the verdict is taken from
    bars = [
        (place, pair, comparison)
        for place, comparison, _ in shown
        if (pair := comparison.simultaneous or comparison.interval)
    ]
    at, pairs, some = zip(*bars, strict=True) if bars else ((), (), ())
    lows, highs = zip(*pairs, strict=True) if pairs else ((), ())
    places, every, middles = zip(*shown, strict=True)
    traces = [
        Trace("no difference", INK.light, "floor", (0.0, 0.0), (-0.5, len(rows) - 0.5)),
        Trace("95 % interval", colour, "range", lows, at, highs, runs=tuple(map(behind_difference, some))),
        Trace("difference", colour, "dots", middles, places, runs=tuple(map(behind_difference, every))),
    ]
    printed = _printed(records, rows, method, rival)
    if printed:
        traces.append(Trace("printed", MUTED.light, "mark", tuple(printed.values()), tuple(printed)))
    stated = "; ".join(
        f"{row.scene} {signed(row.difference)} {interval(row.simultaneous or row.interval)} "
        f"{phrase_with(row.verdict, row.simultaneous or row.interval)}"
        for row in every
    )
    title = f"{method} − {rival} at {words}"
    size = (4.6, 0.75 + 0.25 * len(rows))
    alt = f"{title}, in dB: {stated}."
    return Panel(title, "difference in test PSNR (dB)", "", tuple(traces), alt, rows=rows, size=size)


def _printed(records: Records, rows: tuple[str, ...], method: str, rival: str) -> dict[float, float]:
    """Map place of a row → the printed difference; over `all` if every scene of the run is printed."""
    gains = {row: printed_gain(records, row, method, rival) for row in rows if row != "all"}
    printed = {row: gain for row, gain in gains.items() if gain is not None}
    if printed and len(printed) == len(gains):
        printed["all"] = sum(printed.values()) / len(printed)
    return {float(place): printed[row] for place, row in enumerate(rows) if row in printed}


class Drawn(NamedTuple):
    """Panels that stand together on the page."""

    name: str
    """The beginning of their ids on the page: letters, digits and dashes."""
    section: str
    """The section of the page that shows them."""
    panels: Callable[[Records], list[Panel]]
    title: str = ""
    legend: str = ""
    """What lines and marks mean, behind the methods' colours."""
    note: str = ""
    wide: bool = False
    all_first: bool = False
    """Whether the first panel is of all scenes together, and the others of one each."""


FIGURES = (
    Drawn(
        "difference",
        "psnr",
        difference_panels,
        note="Dots are differences, bars their 95 % intervals; the colour is that of the rival. Hollow diamonds are "
        "the differences that the paper prints.",
        wide=True,
    ),
    Drawn("steps", "convergence", lambda records: convergence(records, "step"), "At equal steps", all_first=True),
    Drawn(
        "seconds",
        "convergence",
        lambda records: convergence(records, "seconds"),
        "At equal training time",
        all_first=True,
    ),
    Drawn(
        "core-seconds",
        "convergence",
        lambda records: convergence(records, "core_seconds"),
        "At equal core seconds",
        all_first=True,
    ),
    Drawn(
        "reach",
        "reaching",
        lambda records: reach_panels(records, ["all"]),
        "Share of runs that have reached it",
        "Kaplan–Meier estimate over all runs of a method. A tick: a run that ended below the target. A cross: one "
        "that diverged or failed, which never gets there.",
    ),
    Drawn(
        "reach-scene",
        "reaching_scenes",
        lambda records: reach_panels(records, records.scenes) if len(records.scenes) > 1 else [],
    ),
    Drawn("density", "amplifier", density_histograms),
    Drawn(
        "over-time",
        "learned",
        amplifier_over_time,
        "What the amplifier learned",
        note="One line a cell. Dashed: where training starts, α = 1/φ and β = 1.",
    ),
)
