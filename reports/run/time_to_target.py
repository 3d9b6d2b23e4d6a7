"""When runs reached a PSNR: curves, and how much sooner. A run that never did is censored, and shown as such."""

from bisect import bisect_left, bisect_right

from harness.records.targets import Axis, Reach, ReachCurve, TargetComparison, TargetsRecord
from reports.claims.psnr_table import ends_of, lines
from reports.data.load import Records
from reports.data.selection import Selection, behind_saving
from reports.data.wording import NARROW, NOTHING, count, counted, interval, number, signed, significant, tone_of_sign
from reports.drawing.palette import colours_of
from reports.drawing.traces import Kind, Panel, Trace
from reports.page.grid import EMPTY, Column, Entry, Grid

AXES: dict[Axis, tuple[str, str, str]] = {
    "steps": ("training step", "fewer steps", "steps"),
    "seconds": ("training seconds", "less training time", "s"),
    "core_seconds": ("core seconds", "fewer core seconds", "core s"),
}
"""Axis → its label, the head of the column of savings, and its unit."""
AT_RISK = 5
"""The number of watched runs below which the curve over all scenes ends."""
BEFORE = 1.6
"""The factor before the first arrival at which a curve begins at 0."""
MARKS: tuple[tuple[bool, Kind, str], ...] = (
    (False, "mark", "ended below the target"),
    (True, "cross", "diverged or failed"),
)


def target_title(record: TargetsRecord) -> str:
    return f"Time to {_target(record)}" if record.target is not None else "Time to a target"


def _target(record: TargetsRecord) -> str:
    return f"{number(record.target, 1).removesuffix('.0')} dB"


def reach_panels(records: Records, scenes: list[str]) -> list[Panel]:
    """Draw the share of runs that have reached the target against every axis of time, scene by scene."""
    record = records.targets
    if record is None or record.target is None:
        return []
    drawn = [_reach_panel(records, record, scene, axis) for scene in scenes for axis in AXES]
    return [panel for panel in drawn if panel is not None]


def _reach_panel(records: Records, record: TargetsRecord, scene: str, axis: Axis) -> Panel | None:
    curves = [curve for curve in record.curves if (curve.scene, curve.axis) == (scene, axis) and curve.time]
    if not curves:
        return None
    start = min(time for curve in curves for time in curve.time) / BEFORE
    everywhere = scene == "all"
    outlines, marks = [], []
    for curve in curves:
        colour = colours_of(records.methods)[curve.method].light
        many = (sum(risk >= AT_RISK for risk in curve.at_risk) if everywhere else 0) or len(curve.time)
        x, y = (start, *curve.time[:many]), (0.0, *curve.share[:many])
        behind = Selection("" if everywhere else scene, curve.method)
        outlines.append(Trace(curve.method, colour, "outline", x, y, runs=(behind,)))
        for lost, kind, words in MARKS:
            ended = [
                reach
                for reach in record.reaches
                if (reach.method, reach.axis, reach.known) == (curve.method, axis, "never")
                and scene in ("all", reach.scene)
                and is_lost(reach) == lost
            ]
            x, y = tuple(reach.time for reach in ended), tuple(share_at(curve, reach.time) for reach in ended)
            runs = tuple(Selection(reach.scene, reach.method, seed=reach.seed) for reach in ended)
            if ended:
                label = f"{curve.method} {words}"
                marks.append(Trace(label, colour, kind, x, y, marker="|", size=11.0, runs=runs))
    title, label = "all scenes" if everywhere else scene, f"share of runs at {_target(record)}"
    ends = "; ".join(f"{curve.method} {curve.share[-1]:.0%} by {curve.time[-1]:.4g}" for curve in curves)
    alt = f"{title}: {label} against {AXES[axis][0]}. {ends}."
    return Panel(title, AXES[axis][0], label, (*outlines, *marks), alt, "log", y_limits=(-0.05, 1.05), size=(3.7, 2.6))


RISK_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""The shares of the longest time watched at which numbers at risk are given."""


def at_risk_grid(record: TargetsRecord) -> Grid | None:
    """Tabulate how many runs of each method were still watched and below the target, over all scenes."""
    curves = [curve for curve in record.curves if curve.scene == "all" and curve.time]
    if not curves:
        return None
    rows = []
    for axis, (_, _, unit) in AXES.items():
        of_axis = [curve for curve in curves if curve.axis == axis]
        longest = max((curve.time[-1] for curve in of_axis), default=0.0)
        times = [share * longest for share in RISK_SHARES]
        for place, curve in enumerate(of_axis):
            words = f"{', '.join(significant(time) for time in times)} {unit}" if place == 0 else ""
            row = [Entry(curve.method, words, runs=Selection("", curve.method))]
            rows.append([*row, *(Entry(count(risk), value=risk) for risk in (watched_at(curve, at) for at in times))])
    columns = [Column("method", numeric=False), *(Column(f"{share:.0%}") for share in RISK_SHARES)]
    note = (
        "Runs that were still watched and had not reached the target, at shares of the longest time; the times are "
        f"below the first method. The curve over all scenes ends where fewer than {AT_RISK} are left."
    )
    return Grid("Numbers at risk", columns, rows, note=note)


def watched_at(curve: ReachCurve, time: float) -> int:
    place = bisect_left(curve.time, time)
    return curve.at_risk[place] if place < len(curve.time) else 0


def is_lost(reach: Reach) -> bool:
    return reach.known == "never" and not reach.why.startswith("ended at")


def share_at(curve: ReachCurve, time: float) -> float:
    """Return the value of the step function, which jumps at the times of `curve`."""
    place = bisect_right(curve.time, time)
    return curve.share[place - 1] if place else 0.0


def notes(record: TargetsRecord) -> list[str]:
    """State how many runs of each method never reached the target, or reached it by the first checkpoint."""
    sentences = []
    for method in dict.fromkeys(reach.method for reach in record.reaches):
        own = [reach for reach in record.reaches if (reach.method, reach.axis) == (method, "steps")]
        lost = sum(map(is_lost, own))
        parts = {
            "ended below it": sum(reach.known == "never" for reach in own) - lost,
            "diverged or failed": lost,
            "had it by the first checkpoint": sum(reach.known == "earlier" for reach in own),
        }
        stated = [f"{many} {words}" for words, many in parts.items() if many]
        sentences += [f"{method}: of {counted(len(own), 'run')}, {', '.join(stated)}."] if stated else []
    return sentences


def savings_grid(record: TargetsRecord, scenes: list[str]) -> Grid | None:
    """Tabulate savings: a row per pair of methods (and scene), a column per axis of time."""
    pairs = dict.fromkeys(
        (saving.scene, saving.method, saving.against) for saving in record.comparisons if saving.scene in scenes
    )
    if not pairs:
        return None
    everywhere, rows = scenes == ["all"], []
    # older runs did not count core seconds
    axes = [axis for axis in AXES if axis != "core_seconds" or any(row.axis == axis for row in record.comparisons)]
    for scene, method, against in sorted(pairs, key=lambda pair: scenes.index(pair[0])):
        savings = [record.comparison(scene, method, against, axis) for axis in axes]
        row = [Entry(method, f"against {against}")] + ([] if everywhere else [Entry(scene)])
        rows.append([*row, *map(saving_entry, savings)])
    columns = [Column("method", numeric=False)] + ([] if everywhere else [Column("scene", numeric=False)])
    columns += [Column(AXES[axis][1]) for axis in axes]
    note = (
        "Percentage saved of the time to the target, or to the horizon where that comes first (geometric mean over "
        "pairs; negative: slower), with the 95 % interval that the verdict is taken from. Where runs were cut short by "
        "the horizon it does not estimate the saving to the target itself; a bound on that is given if there is one."
    )
    title = "How much sooner, over all scenes" if everywhere else "How much sooner, scene by scene"
    return Grid(title, columns, rows, note=note if everywhere else "")


def saving_entry(saving: TargetComparison | None) -> Entry:
    if saving is None:
        return EMPTY
    censored = [
        f"{words}:\n{count(many)} of {counted(saving.pairs, 'run')} of {method}"
        for words, pair in (("not within the time watched", saving.never), ("there at once", saving.earlier))
        for method, many in zip((saving.method, saving.against), pair, strict=True)
        if many
    ]
    if saving.saving is not None and censored:
        ends = ((saving.at_least, "or more"), (saving.at_most, "or less"))
        censored += [
            f"to the target itself {signed(end, 1)}{NARROW}% {words}" for end, words in ends if end is not None
        ]
        censored.append(f"horizon {number(saving.horizon, 0)} {AXES[saving.axis][2]}")
    least = saving.smallest_detectable
    detectable = "" if least is None else f"detectable {number(least, 0)}{NARROW}%"
    lost = f"{counted(saving.unpaired, 'pair')} not judged" if saving.unpaired else ""
    pair = None if saving.saving is None else saving.simultaneous or saving.interval
    return Entry(
        NOTHING if saving.saving is None else f"{signed(saving.saving, 1)}{NARROW}%",
        lines(interval(pair, 1), saving.verdict.phrase, detectable, *censored, lost),
        tone_of_sign(saving.verdict.sign),
        saving.saving,
        {} if saving.saving is None else {**ends_of(pair), "detectable": least},
        behind_saving(saving),
    )
