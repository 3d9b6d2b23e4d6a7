"""PSNR against steps and seconds, differences with their intervals, and when runs reached a PSNR.

Every seed is thin, the mean thick, a cross stands where a run diverged; a run that never reached a PSNR is censored and
stays in sight.
"""

from bisect import bisect_right
from dataclasses import dataclass
from typing import Literal

import pandas as pd

from harness.records.targets import Axis, Reach, ReachCurve, TargetComparison, TargetsRecord
from reports.claims.headline import BUDGETS, roles
from reports.claims.psnr_table import lines
from reports.data.load import Records
from reports.data.selection import Selection, behind_difference, behind_saving
from reports.data.table import curves_frame
from reports.data.wording import NARROW, count, counted, interval, number, signed
from reports.drawing.figure import with_common_limits
from reports.drawing.palette import INK, MUTED, colours_of
from reports.drawing.traces import Kind, Panel, Trace
from reports.page.grid import EMPTY, Column, Entry, Grid

CurveAxis = Literal["step", "seconds"]

NEAR_DB = 2.0

LABELS: dict[CurveAxis, str] = {"step": "training step", "seconds": "training seconds"}
SCORE = "test PSNR (dB)"


def convergence(records: Records, axis: CurveAxis) -> list[Panel]:
    """Draw one panel per scene, the mean over all scenes first."""
    curves = curves_frame(records)
    panels = curve_panels(records, curves, axis)
    floors = {scene.name: (scene.psnr_floor, scene.psnr_ceiling) for scene in records.run.scenes}
    with_lines = []
    for panel in panels:
        low, high = floors.get(panel.title, (None, None))
        with_lines.append(_with_level(_with_level(panel, "floor", low), "ceiling", high))
    return with_common_limits(with_lines, "x")


def curve_panels(records: Records, curves: pd.DataFrame, axis: CurveAxis) -> list[Panel]:
    """Draw PSNR against `axis` in each scene and, with more than one scene, in their mean."""
    colours = {method: colour.light for method, colour in colours_of(records.methods).items()}
    panels = []
    everywhere = mean_over_scenes(curves, records.scenes)
    if len(records.scenes) > 1 and not everywhere.empty:
        panels.append(_panel("all scenes (mean)", everywhere, colours, axis))
    for scene in records.scenes:
        chosen = curves[curves["scene"] == scene]
        if chosen[[axis, "psnr"]].dropna().empty:
            continue
        panels.append(_panel(scene, chosen, colours, axis))
    return panels


def mean_over_scenes(curves: pd.DataFrame, scenes: list[str]) -> pd.DataFrame:
    """Return the mean per method, seed and step, if every scene has a finished score there."""
    done = curves[(curves["status"] == "done")].dropna(subset=["psnr"])
    grouped = done.groupby(["method", "seed", "step"], sort=True)
    means = grouped[["seconds", "psnr"]].mean()
    means["many"] = grouped["scene"].nunique()
    return means[means["many"] == len(scenes)].reset_index().assign(status="done")


def traces_of(curves: pd.DataFrame, colours: dict[str, str], axis: CurveAxis) -> tuple[Trace, ...]:
    """Return thin lines for the seeds, then thick means, then crosses."""
    thin, thick, crosses = [], [], []
    for method, colour in colours.items():
        of_method = curves[curves["method"] == method]
        finished = []
        for seed, of_seed in of_method.groupby("seed"):
            points = of_seed.dropna(subset=[axis, "psnr"])
            points = points[points[axis] > 0]
            if points.empty:
                continue
            x, y = tuple(map(float, points[axis])), tuple(map(float, points["psnr"]))
            steps, behind = tuple(map(int, points["step"])), behind_curve(points, method, int(seed))
            thin.append(Trace(f"{method} seed {seed}", colour, "thin", x, y, runs=behind, steps=steps))
            if set(of_seed["status"]) == {"diverged"}:
                words = f"{method} seed {seed} diverged"
                crosses.append(Trace(words, colour, "cross", x[-1:], y[-1:], runs=behind, steps=steps[-1:]))
            elif set(of_seed["status"]) == {"done"}:
                finished.append(points)
        if finished:
            thick.append(_mean_trace(method, colour, finished, axis))
    return (*thin, *[trace for trace in thick if trace.x], *crosses)


def _mean_trace(method: str, colour: str, finished: list[pd.DataFrame], axis: CurveAxis) -> Trace:
    """Return the mean over the finished seeds, at the steps that they share."""
    together = pd.concat(finished)
    by_step = together.groupby("step").agg(
        x=(axis if axis != "step" else "seconds", "mean"), y=("psnr", "mean"), many=("psnr", "size")
    )
    shared = by_step[by_step["many"] == len(finished)]
    x = shared.index if axis == "step" else shared["x"]
    behind, steps = behind_curve(together, method), tuple(map(int, shared.index))
    x, y = tuple(map(float, x)), tuple(map(float, shared["y"]))
    return Trace(f"{method} mean", colour, "line", x, y, runs=behind, steps=steps)


def behind_curve(points: pd.DataFrame, method: str, seed: int | None = None) -> tuple[Selection, ...]:
    """Select the runs of a curve; without a scene if it is a mean over scenes."""
    scenes = set(points["scene"]) if "scene" in points else set()
    return (Selection(scenes.pop() if len(scenes) == 1 else "", method, metric="psnr", seed=seed),)


def _panel(title: str, curves: pd.DataFrame, colours: dict[str, str], axis: CurveAxis) -> Panel:
    traces = traces_of(curves, colours, axis)
    ends = [f"{trace.label.removesuffix(' mean')} {trace.y[-1]:.4g}" for trace in traces if trace.kind == "line"]
    ends += [trace.label for trace in traces if trace.kind == "cross"]
    alt = f"{title}: {SCORE} against {LABELS[axis]}. At the end: {', '.join(ends) or 'no finished run'}."
    return Panel(title, LABELS[axis], SCORE, traces, alt, "log", "linear")


def _with_level(panel: Panel, label: str, level: float | None) -> Panel:
    """Draw a dashed level across the panel; one that is far from all curves is left to the table."""
    xs = [x for trace in panel.traces for x in trace.x]
    ys = [y for trace in panel.traces for y in trace.y]
    if level is None or not xs or not min(ys) - NEAR_DB <= level <= max(ys) + NEAR_DB:
        return panel
    colour = INK.light if label == "ceiling" else MUTED.light
    line = Trace(label, colour, "floor", (min(xs), max(xs)), (level, level))
    return Panel(**{**panel.__dict__, "traces": (*panel.traces, line)})


def difference_panels(records: Records) -> list[Panel]:
    """Draw for the contender of the headline one panel per budget and rival, one row per scene, the
    mean at the bottom.
    """
    cast = roles(records)
    if not cast.contenders:
        return []
    method = cast.contenders[0]
    panels = []
    for budget, words in BUDGETS:
        for rival in (cast.baseline, cast.control):
            if rival and rival != method:
                panel = _differences_panel(records, method, rival, budget, words)
                panels += [panel] if panel else []
    return with_common_limits(panels, "x")


def _differences_panel(records: Records, method: str, rival: str, budget: str, words: str) -> Panel | None:
    rows = [scene for scene in [*records.scenes, "all"] if records.comparison(scene, method, rival, budget=budget)]
    found = {scene: records.comparison(scene, method, rival, budget=budget) for scene in rows}
    shown = [(place, one) for place, one in enumerate(found.values()) if one and one.difference is not None]
    if not shown:
        return None
    colour = colours_of(records.methods)[rival].light
    # in a family, the interval that the verdict is taken from
    with_interval = [(place, pair) for place, one in shown if (pair := one.simultaneous or one.interval)]
    behind = {place: behind_difference(one) for place, one in shown}
    traces = [
        Trace("no difference", INK.light, "floor", (0.0, 0.0), (-0.5, len(rows) - 0.5)),
        Trace(
            "95 % interval",
            colour,
            "range",
            tuple(pair[0] for _, pair in with_interval),
            tuple(float(place) for place, _ in with_interval),
            tuple(pair[1] for _, pair in with_interval),
            runs=tuple(behind[place] for place, _ in with_interval),
        ),
        Trace(
            "difference",
            colour,
            "dots",
            tuple(one.difference for _, one in shown if one.difference is not None),
            tuple(float(place) for place, _ in shown),
            runs=tuple(behind.values()),
        ),
    ]
    if rival == "nerf" and method == "qnerf":
        traces += _printed(records, rows)
    said = [
        f"{one.scene} {signed(one.difference)} {interval(one.simultaneous or one.interval)} {one.verdict}"
        for _, one in shown
    ]
    title = f"{method} − {rival} at {words}"
    height = 0.75 + 0.25 * len(rows)
    alt = f"{title}, in dB: {'; '.join(said)}."
    return Panel(title, "difference in test PSNR (dB)", "", tuple(traces), alt, rows=tuple(rows), size=(4.6, height))


def _printed(records: Records, rows: list[str]) -> list[Trace]:
    """Draw the paper's differences as hollow diamonds."""
    table = records.run.paper.get("table2") or {}
    printed = {scene.lower(): row["qnerf"] - row["nerf"] for scene, row in table.items() if "qnerf" in row}
    if printed and set(rows) - {"all"} <= set(printed):
        printed["all"] = sum(printed[row] for row in rows if row != "all") / max(len(rows) - 1, 1)
    there = [(place, printed[row]) for place, row in enumerate(rows) if row in printed]
    if not there:
        return []
    x, y = tuple(value for _, value in there), tuple(float(place) for place, _ in there)
    return [Trace("printed in the paper", MUTED.light, "mark", x, y)]


AXES: dict[Axis, tuple[str, str]] = {
    "steps": ("training step", "fewer steps"),
    "seconds": ("training seconds", "less training time"),
}
AT_RISK = 5
"""The number of watched runs below which the curve over all scenes ends."""
BEFORE = 1.6
"""The factor before the first arrival at which a curve begins at 0."""
EVERYWHERE = "all scenes"


@dataclass(frozen=True)
class TimeToTarget:
    title: str
    declared: str
    """The target, and its reason."""
    everywhere: list[Panel]
    """The panels over all scenes, one per axis."""
    scenes: list[Panel]
    notes: list[str]
    savings: Grid | None
    by_scene: Grid | None


def time_to_target(records: Records) -> TimeToTarget | None:
    """Return the section; None for a run recorded before there was such a record."""
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
    """Draw the share of runs that have reached the target against steps and against seconds."""
    found = [_survival_panel(records, record, scene, axis) for axis in AXES]
    return [panel for panel in found if panel is not None]


def _survival_panel(records: Records, record: TargetsRecord, scene: str, axis: Axis) -> Panel | None:
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
    """Return how many points of the curve rest on `AT_RISK` runs or more; all if there never were as many."""
    many = sum(risk >= AT_RISK for risk in curve.at_risk)
    return many or len(curve.time)


def _marks(curve: ReachCurve, never: list[Reach], colour: str) -> list[Trace]:
    """Draw a tick where a run was last seen below the target, a cross where one diverged or failed."""
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
    """Return the share of the step function, which holds from each time on."""
    place = bisect_right(curve.time, time)
    return curve.share[place - 1] if place else 0.0


def notes(record: TargetsRecord) -> list[str]:
    """State how many runs of each method never got there, or were there before anybody looked."""
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
    """Tabulate one row per pair of methods (and scene), steps and seconds beside each other."""
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
    """Return `+18.0 %`, below it interval, verdict, and how many runs say less than a time."""
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
