"""When runs reached a PSNR → curves and a table: a run that never got there is censored and stays in sight.

The curves are those of Kaplan and Meier, as the record holds them; nothing is estimated here.
"""

from bisect import bisect_right
from dataclasses import dataclass

from harness.targets_record import Axis, Reach, ReachCurve, TargetComparison, TargetsRecord
from reports.grid import EMPTY, Column, Entry, Grid
from reports.load import Records
from reports.palette import colours_of
from reports.psnr_table import lines
from reports.selection import Selection, behind_saving
from reports.trace_data import Kind, Panel, Trace
from reports.wording import NARROW, count, counted, interval, number, signed

AXES: dict[Axis, tuple[str, str]] = {
    "steps": ("training step", "fewer steps"),
    "seconds": ("training seconds", "less training time"),
}
AT_RISK = 5
"""The curve over all scenes ends where fewer runs are still watched."""
BEFORE = 1.6
"""A curve begins at 0 so many times before anybody got there."""
EVERYWHERE = "all scenes"


@dataclass(frozen=True)
class TimeToTarget:
    title: str
    declared: str
    """The target, and why it is that."""
    everywhere: list[Panel]
    """Over all scenes, one an axis."""
    scenes: list[Panel]
    notes: list[str]
    savings: Grid | None
    by_scene: Grid | None


def time_to_target(records: Records) -> TimeToTarget | None:
    """None for a run recorded before there was such a record."""
    record = records.targets
    if record is None:
        return None
    if record.target is None:
        return TimeToTarget("Time to a target", record.declared, [], [], [], None, None)
    panels = {scene: panels_of(records, record, scene) for scene in ("all", *records.scenes)}
    return TimeToTarget(
        f"Time to {number(record.target, 1).removesuffix('.0')} dB",
        record.declared,
        panels.pop("all"),
        [panel for found in panels.values() for panel in found] if len(records.scenes) > 1 else [],
        notes(record),
        savings_grid(record, ["all"]),
        savings_grid(record, records.scenes) if len(records.scenes) > 1 else None,
    )


def panels_of(records: Records, record: TargetsRecord, scene: str) -> list[Panel]:
    """The share of runs that have reached the target against steps and against seconds."""
    found = [_panel(records, record, scene, axis) for axis in AXES]
    return [panel for panel in found if panel is not None]


def _panel(records: Records, record: TargetsRecord, scene: str, axis: Axis) -> Panel | None:
    curves = [one for one in record.curves if (one.scene, one.axis) == (scene, axis) and one.time]
    if not curves:
        return None
    colours = {method: colour.light for method, colour in colours_of(records.methods).items()}
    start = min(time for one in curves for time in one.time) / BEFORE
    reaches = [one for one in record.reaches if one.axis == axis and scene in ("all", one.scene)]
    everywhere = scene == "all"
    traces = [
        Trace(
            one.method,
            colours[one.method],
            "outline",
            (start, *one.time[: (many := _known(one) if everywhere else len(one.time))]),
            (0.0, *one.share[:many]),
            runs=(Selection("" if everywhere else scene, one.method),),
        )
        for one in curves
    ]
    for curve in curves:
        own = [one for one in reaches if one.method == curve.method and one.known == "never"]
        traces += _marks(curve, own, colours[curve.method])
    title = EVERYWHERE if everywhere else scene
    label = f"share of runs at {number(record.target, 1).removesuffix('.0')} dB"
    said = [f"{one.method} {one.share[-1]:.0%} by {one.time[-1]:.4g}" for one in curves]
    alt = f"{title}: {label} against {AXES[axis][0]}. {'; '.join(said)}."
    size = (4.6, 3.0) if scene == "all" else (3.7, 2.6)
    return Panel(title, AXES[axis][0], label, tuple(traces), alt, "log", y_limits=(-0.05, 1.05), size=size)


def _known(curve: ReachCurve) -> int:
    """So many points of the curve rest on `AT_RISK` runs or more; all where there never were as many."""
    many = sum(risk >= AT_RISK for risk in curve.at_risk)
    return many or len(curve.time)


def _marks(curve: ReachCurve, never: list[Reach], colour: str) -> list[Trace]:
    """A tick where a run was last seen below the target, a cross where one diverged or failed."""
    found = []
    kinds: tuple[tuple[bool, Kind], ...] = ((False, "mark"), (True, "cross"))
    for lost, kind in kinds:
        x = tuple(one.time for one in never if is_lost(one) == lost)
        if x:
            words = "diverged or failed" if lost else "ended below the target"
            y = tuple(share_at(curve, time) for time in x)
            ended = [one for one in never if is_lost(one) == lost]
            behind = tuple(Selection(one.scene, one.method, seed=one.seed) for one in ended)
            found.append(Trace(f"{curve.method} {words}", colour, kind, x, y, marker="|", size=11.0, runs=behind))
    return found


def is_lost(one: Reach) -> bool:
    return one.known == "never" and not one.why.startswith("ended at")


def share_at(curve: ReachCurve, time: float) -> float:
    """Of the step function: what holds from each time on."""
    place = bisect_right(curve.time, time)
    return curve.share[place - 1] if place else 0.0


def notes(record: TargetsRecord) -> list[str]:
    """How many runs of each method never got there, or were there before anybody looked."""
    runs: dict[str, list[Reach]] = {}
    for one in record.reaches:
        if one.axis == "steps":
            runs.setdefault(one.method, []).append(one)
    said = []
    for method, own in runs.items():
        lost, never, earlier = (
            sum(is_lost(one) for one in own),
            sum(one.known == "never" and not is_lost(one) for one in own),
            sum(one.known == "earlier" for one in own),
        )
        parts = [f"{never} ended below it"] if never else []
        parts += [f"{lost} diverged or failed"] if lost else []
        parts += [f"{earlier} had it by the first checkpoint"] if earlier else []
        if parts:
            said.append(f"{method}: of {counted(len(own), 'run')}, {', '.join(parts)}.")
    return said


def savings_grid(record: TargetsRecord, scenes: list[str]) -> Grid | None:
    """A row a pair of methods (and scene), steps and seconds beside each other."""
    chosen = [one for one in record.comparisons if one.scene in scenes]
    if not chosen:
        return None
    rows = []
    for scene in scenes:
        for method, against in dict.fromkeys((one.method, one.against) for one in chosen if one.scene == scene):
            found = [record.comparison(scene, method, against, axis) for axis in AXES]
            row = [Entry(method, f"against {against}")] + ([] if scenes == ["all"] else [Entry(scene)])
            rows.append([*row, *map(saving_entry, found), *map(detectable_entry, found)])
    columns = [Column("method", numeric=False)] + ([] if scenes == ["all"] else [Column("scene", numeric=False)])
    columns += [Column(words) for _, words in AXES.values()]
    columns += [Column("could detect", small=words.removeprefix("fewer ").removeprefix("less training "))
                for _, words in AXES.values()]  # fmt: skip
    note = (
        "Percentage saved of the time to the target, or to the horizon where that comes first (geometric mean over "
        "pairs; negative: slower), with the 95 % interval that the verdict is taken from. Where runs were cut short by "
        "the horizon it is no estimate of the time to the target itself, but a bound of it where one is given."
    )
    title = "How much sooner, over all scenes" if scenes == ["all"] else "How much sooner, scene by scene"
    return Grid(title, columns, rows, note=note if scenes == ["all"] else "")


def saving_entry(one: TargetComparison | None) -> Entry:
    """`+18.0 %`, below it interval, verdict, and how many runs say less than a time."""
    if one is None:
        return EMPTY
    censored = [
        f"{words}: {count(many)} of {counted(one.pairs, 'run')} of {method}"
        for words, pair in (("not within the time watched", one.never), ("there at once", one.earlier))
        for method, many in zip((one.method, one.against), pair, strict=True)
        if many
    ]
    if one.saving is not None and censored:
        ends = ((one.at_least, "or more"), (one.at_most, "or less"))
        censored += [
            f"to the target itself {signed(end, 1)}{NARROW}% {words}" for end, words in ends if end is not None
        ]
        censored.append(f"horizon {number(one.horizon, 0)} {'steps' if one.axis == 'steps' else 's'}")
    aside = f"{counted(one.unpaired, 'pair')} not judged" if one.unpaired else ""
    behind = behind_saving(one)
    if one.saving is None:
        return Entry("–", lines(one.verdict, *censored, aside), one.verdict, runs=behind)
    small = lines(interval(one.simultaneous or one.interval, 1), one.verdict, *censored, aside)
    low, high = one.simultaneous or one.interval or (None, None)
    said = f"{signed(one.saving, 1)}{NARROW}%"
    return Entry(said, small, one.verdict, one.saving, {"low": low, "high": high}, behind)


def detectable_entry(one: TargetComparison | None) -> Entry:
    if one is None or one.smallest_detectable is None:
        return EMPTY
    return Entry(f"{number(one.smallest_detectable, 0)}{NARROW}%", tone="muted")
