"""Every figure of a run's page as an entry of `FIGURES`; the ruler of its first screen, and differences as rows."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from harness.records.cells import Budget, Comparison, Estimate
from harness.records.metric_table import METRICS, PRIMARY
from harness.records.verdict import phrase_with
from reports.claims.psnr_table import printed_gains
from reports.data.load import Records
from reports.data.selection import behind_difference
from reports.data.wording import BUDGETS, interval, mark_of, signed
from reports.drawing.figure import padded, with_common_limits
from reports.drawing.palette import INK, MUTED, colours_of
from reports.drawing.traces import Panel, Trace
from reports.run.curves import convergence
from reports.run.density import amplifier_over_time, density_histograms
from reports.run.time_to_target import reach_panels

MARGIN = METRICS[PRIMARY].smallest_of_interest
FARTHEST = 2.5
"""How far the ruler reaches beyond its largest difference; a longer interval is cut, and printed next to it."""


def ruler(records: Records) -> Panel | None:
    """Draw the first contender's differences in PSNR over all scenes, in both senses and as claimed, if it has any."""
    rows: list[tuple[str, Comparison, Estimate | None]] = []
    claimed: list[tuple[float, float, float]] = []
    for method in records.contenders[:1]:
        for rival in (rival for rival in records.rivals if rival != method):
            row = records.comparison("all", method, rival)
            if row is None or row.difference is None:
                continue
            claimed += [(low, float(len(rows)), high) for low, high in _claimed(records, method, rival)]
            senses = {"these scenes": row.on_these_scenes, "scenes like these": row.scenes_like_these}
            known = [words for words, estimate in senses.items() if estimate] or ["these scenes"]
            rows += [(f"− {rival}\n{words}", row, senses[words]) for words in known]
    if not rows:
        return None
    ends, band = (-0.5, len(rows) - 0.5), f"±{MARGIN:g} dB, too small to matter"
    corners = (-MARGIN, MARGIN, MARGIN, -MARGIN), (ends[0], ends[0], ends[1], ends[1])
    traces = [
        Trace(band, MUTED.light, "area", *corners),
        Trace("no difference", INK.light, "floor", (0.0, 0.0), ends),
    ]
    figures, values = [], [1.5 * MARGIN, -1.5 * MARGIN]
    for line, (_, row, estimate) in enumerate(rows):
        at, difference, runs = (float(line),), row.difference or 0.0, (behind_difference(row),)
        pair = (estimate.simultaneous or estimate.interval) if estimate else None
        colour = colours_of(records.methods)[row.against].light
        if pair is not None:
            traces.append(Trace("95 % interval", colour, "range", (pair[0],), at, (pair[1],), runs=runs))
        traces.append(Trace("difference", colour, "dots", (difference,), at, runs=runs))
        mark = mark_of(estimate.verdict) if estimate else ""
        figures.append(" ".join(filter(None, [signed(difference), interval(pair), mark])))
        values += [difference, *(pair or ())]
    for low, place, high in claimed:
        if low < high:
            traces.append(Trace("claimed", MUTED.light, "range", (low,), (place,), (high,)))
        traces.append(Trace("claimed", MUTED.light, "mark", tuple({low, high}), (place,) * len({low, high})))
        values += [low, high]
    reach = FARTHEST * max(abs(each) for each in [*(row.difference or 0.0 for _, row, _ in rows), *values[:2]])
    reach = max([reach, *(1.1 * abs(end) for low, _, high in claimed for end in (low, high))])
    names = tuple(row[0] for row in rows)
    words = "; ".join(f"{name} {figure}".replace("\n", ", ") for name, figure in zip(names, figures, strict=True))
    title = f"{records.contenders[0]}: difference in mean test PSNR at equal steps"
    return Panel(
        title,
        "difference in test PSNR (dB)",
        "",
        tuple(traces),
        f"{title}, in dB, 95 % intervals: {words}.",
        x_limits=padded([min(max(value, -reach), reach) for value in values], log=False),
        rows=names,
        figures=tuple(figures),
        size=(4.8, 0.7 + 0.36 * len(rows)),
    )


def _claimed(records: Records, method: str, rival: str) -> list[tuple[float, float]]:
    """Return the claimed differences of two methods in PSNR over all scenes, each as the ends of a range."""
    about = {"method": method, "against": rival, "scene": "all", "metric": PRIMARY}
    statements = [claim for file in records.run.claims or [] for claim in file.claims if claim.quantity == "gain"]
    printed = [claim.printed for claim in statements if about.items() <= claim.of.items()]
    pairs = [each if isinstance(each, tuple) else (each, each) for each in printed if each is not None]
    return [(float(low), float(high)) for low, high in dict.fromkeys(pairs)]


def difference_panels(records: Records) -> list[Panel]:
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
    gains = printed_gains(records, [row for row in rows if row != "all"], method, rival)
    if printed := {float(place): gains[row] for place, row in enumerate(rows) if row in gains}:
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
    Drawn("ruler", "answer", lambda records: list(filter(None, [ruler(records)]))),
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
