"""PSNR against steps and against training seconds: every seed thin, the mean thick, a cross where a run diverged."""

from typing import Literal

import pandas as pd

from reports.figure import with_common_limits
from reports.load import Records
from reports.palette import INK, MUTED, colours_of
from reports.selection import Selection
from reports.table import curves_frame
from reports.trace_data import Panel, Trace

Axis = Literal["step", "seconds"]

NEAR_DB = 2.0

LABELS: dict[Axis, str] = {"step": "training step", "seconds": "training seconds"}
SCORE = "test PSNR (dB)"


def convergence(records: Records, axis: Axis) -> list[Panel]:
    """One panel a scene, the mean over all scenes first."""
    curves = curves_frame(records)
    panels = curve_panels(records, curves, axis)
    floors = {scene.name: (scene.psnr_floor, scene.psnr_ceiling) for scene in records.run.scenes}
    with_lines = []
    for panel in panels:
        low, high = floors.get(panel.title, (None, None))
        with_lines.append(_with_level(_with_level(panel, "floor", low), "ceiling", high))
    return with_common_limits(with_lines, "x")


def curve_panels(records: Records, curves: pd.DataFrame, axis: Axis) -> list[Panel]:
    """PSNR against `axis` in each scene and, with more than one scene, in their mean."""
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
    """Per method, seed and step, where every scene has a finished score there."""
    done = curves[(curves["status"] == "done")].dropna(subset=["psnr"])
    grouped = done.groupby(["method", "seed", "step"], sort=True)
    means = grouped[["seconds", "psnr"]].mean()
    means["many"] = grouped["scene"].nunique()
    return means[means["many"] == len(scenes)].reset_index().assign(status="done")


def traces_of(curves: pd.DataFrame, colours: dict[str, str], axis: Axis) -> tuple[Trace, ...]:
    """Thin lines for the seeds, then thick means, then crosses."""
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


def _mean_trace(method: str, colour: str, finished: list[pd.DataFrame], axis: Axis) -> Trace:
    """The mean over the finished seeds, at the steps that they share."""
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
    """The runs of a curve; without a scene where it is a mean over scenes."""
    scenes = set(points["scene"]) if "scene" in points else set()
    return (Selection(scenes.pop() if len(scenes) == 1 else "", method, metric="psnr", seed=seed),)


def _panel(title: str, curves: pd.DataFrame, colours: dict[str, str], axis: Axis) -> Panel:
    traces = traces_of(curves, colours, axis)
    ends = [f"{trace.label.removesuffix(' mean')} {trace.y[-1]:.4g}" for trace in traces if trace.kind == "line"]
    ends += [trace.label for trace in traces if trace.kind == "cross"]
    alt = f"{title}: {SCORE} against {LABELS[axis]}. At the end: {', '.join(ends) or 'no finished run'}."
    return Panel(title, LABELS[axis], SCORE, traces, alt, "log", "linear")


def _with_level(panel: Panel, label: str, level: float | None) -> Panel:
    """A dashed level across the panel; one that is far from all curves is left to the table."""
    xs = [x for trace in panel.traces for x in trace.x]
    ys = [y for trace in panel.traces for y in trace.y]
    if level is None or not xs or not min(ys) - NEAR_DB <= level <= max(ys) + NEAR_DB:
        return panel
    colour = INK.light if label == "ceiling" else MUTED.light
    line = Trace(label, colour, "floor", (min(xs), max(xs)), (level, level))
    return Panel(**{**panel.__dict__, "traces": (*panel.traces, line)})
