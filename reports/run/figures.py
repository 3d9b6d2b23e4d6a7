"""Every figure of a run's page as an entry of `FIGURES`, and the differences of the headline drawn as rows."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from harness.records.cells import Budget
from harness.records.verdict import phrase_with
from reports.claims.psnr_table import printed_gain
from reports.data.load import Records
from reports.data.selection import behind_difference
from reports.data.wording import BUDGETS, interval, signed
from reports.drawing.figure import with_common_limits
from reports.drawing.palette import INK, MUTED, colours_of
from reports.drawing.traces import Panel, Trace
from reports.run.curves import convergence
from reports.run.density import amplifier_over_time, density_histograms
from reports.run.time_to_target import reach_panels


def difference_panels(records: Records) -> list[Panel]:
    """Draw the contender of the headline, a panel per budget and rival, with a row per scene and the mean below."""
    drawn = [
        _differences_panel(records, method, rival, budget)
        for method in records.contenders[:1]
        for budget in records.budgets
        for rival in records.rivals
        if rival != method
    ]
    return with_common_limits([panel for panel in drawn if panel is not None], "x")


def _differences_panel(records: Records, method: str, rival: str, budget: Budget) -> Panel | None:
    compared = [records.comparison(scene, method, rival, budget=budget) for scene in (*records.scenes, "all")]
    known = [comparison for comparison in compared if comparison is not None]
    rows = tuple(comparison.scene for comparison in known)
    shown = [
        (float(place), comparison, comparison.difference)
        for place, comparison in enumerate(known)
        if comparison.difference is not None
    ]
    if not shown:
        return None
    colour = colours_of(records.methods)[rival].light
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
    if printed := _printed(records, rows, method, rival):
        traces.append(Trace("printed", MUTED.light, "mark", tuple(printed.values()), tuple(printed)))
    stated = "; ".join(
        f"{row.scene} {signed(row.difference)} {interval(row.simultaneous or row.interval)} "
        f"{phrase_with(row.verdict, row.simultaneous or row.interval)}"
        for row in every
    )
    title = f"{method} − {rival} at {BUDGETS[budget]}"
    size = (4.6, 0.75 + 0.25 * len(rows))
    alt = f"{title}, in dB: {stated}."
    return Panel(title, "difference in test PSNR (dB)", "", tuple(traces), alt, rows=rows, size=size)


def _printed(records: Records, rows: tuple[str, ...], method: str, rival: str) -> dict[float, float]:
    """Map place of a row → the printed difference; the row `all` has one if every scene of the run has."""
    gains = {row: printed_gain(records, row, method, rival) for row in rows if row != "all"}
    printed = {row: gain for row, gain in gains.items() if gain is not None}
    if printed and len(printed) == len(gains):
        printed["all"] = sum(printed.values()) / len(printed)
    return {float(place): printed[row] for place, row in enumerate(rows) if row in printed}


class Drawn(NamedTuple):
    name: str
    """The beginning of the panels' ids on the page: letters, digits and dashes."""
    section: str
    panels: Callable[[Records], list[Panel]]
    title: str = ""
    legend: str = ""
    note: str = ""
    wide: bool = False
    all_first: bool = False
    """Whether the first panel shows all scenes together, and each of the others one scene."""


FIGURES = (
    Drawn(
        "difference",
        "psnr",
        difference_panels,
        note="Dots are differences, bars their 95 % intervals; the colour is that of the rival. Hollow diamonds are "
        "the differences that the paper prints.",
        wide=True,
    ),
    *(
        Drawn(name, "convergence", partial(convergence, axis=axis), f"At equal {words}", all_first=True)
        for name, axis, words in (
            ("steps", "step", "steps"),
            ("seconds", "seconds", "training time"),
            ("core-seconds", "core_seconds", "core seconds"),
        )
    ),
    Drawn(
        "reach",
        "reaching",
        lambda records: reach_panels(records, ["all"]),
        "Share of runs that have reached it",
        "Kaplan–Meier estimate over all runs of a method. A tick: a run that ended below the target. A cross: a run "
        "that diverged or failed, and never reaches it.",
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
        note="One line per cell. Dashed: where training starts, α = 1/φ and β = 1.",
    ),
)
