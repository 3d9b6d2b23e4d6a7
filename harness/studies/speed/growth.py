"""Question 9: how seconds grow with rays, samples, width, resolution, scenes and seeds."""

import math
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from msgspec import structs

from harness.execution.local_executor import run_locally
from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.plan.settings import GridSettings, TrainSettings
from harness.records.study import Check, Series
from harness.studies.drawn_views import FOV_X_RADIANS, poses, write_disc
from harness.studies.power_laws import fitted_power
from harness.studies.speed.speed_context import (
    DENSE,
    Seconds,
    SpeedContext,
    figure,
    interleaved,
    reduced_plan,
    synthetic_batch,
    trained_reduced,
)
from harness.studies.speed.throughput import dense_side
from harness.training.batches import Cameras
from harness.training.scoring.evaluate import render_view

STEPS: tuple[tuple[str, tuple[int, ...], Callable[[TrainSettings, int], TrainSettings], str], ...] = (
    ("rays", (128, 256, 512, 1024, 2048), lambda base, size: replace(base, rays=size), "rays per step"),
    ("samples", (16, 32, 64, 128), lambda base, size: replace(base, bins=size, first_bins=size), "samples per ray"),
    ("width", (32, 64, 128, 256, 512), lambda base, size: replace(base, network=replace(base.network, width=size)),
     "layer width"),
)  # fmt: skip
"""What grows, its sizes, the settings at a size, and the label of the axis."""
RESOLUTIONS, QUICK_RESOLUTIONS = (50, 71, 100, 141, 200), (8, 12, 16)
SEEDS = (1, 2, 4)
CELL_STEPS = 400


def measure(context: SpeedContext) -> Iterator[Check | Series]:
    # all samples are evaluated, so that work is exactly proportional to their number
    train = reduced_plan(context).train
    dense = replace(train, first_bins=train.bins, grid=GridSettings(cells=0), accelerations=DENSE)
    for name, sizes, settings_at, label in STEPS:
        sides: dict[str, Callable[[], object]] = {}
        for size in sizes[:3] if context.quick else sizes:
            settings = settings_at(dense, size)
            sides[str(size)] = dense_side(context, settings, synthetic_batch(context, settings.rays))
        yield from _reported(context, name, label, "s per training step", _timed(context, sides))
    trainer = trained_reduced(context)
    views: dict[str, Callable[[], object]] = {}
    for size in QUICK_RESOLUTIONS if context.quick else RESOLUTIONS:
        focal = 0.5 * size / math.tan(0.5 * FOV_X_RADIANS)
        cameras = Cameras.of(poses(3, 0.5), size, size, focal, 2.0, 6.0).to(context.device)
        views[str(size)] = partial(render_view, trainer, cameras, 1, reduced_plan(context).score.chunk)
    yield from _reported(context, "resolution", "width of a view (px)", "s per view", _timed(context, views))
    if context.device.type == "cpu":
        wall = {str(count): [run_seconds(context, count)] for count in (SEEDS[:2] if context.quick else SEEDS)}
        yield from _reported(context, "seeds", "seeds of a run", "wall seconds of a run", wall)


def _timed(context: SpeedContext, sides: dict[str, Callable[[], object]]) -> Seconds:
    return interleaved(sides, context.repeats(5), context.synchronise, 0.0 if context.quick else 0.1)


def exponent(x: list[float], y: list[float]) -> tuple[float, float, float]:
    """Return the slope of log y over log x: the fit, and the smallest and largest between neighbours."""
    between = np.diff(np.log(y)) / np.diff(np.log(x))
    return fitted_power(x, y)[0], float(between.min()), float(between.max())


def _reported(
    context: SpeedContext, name: str, x_label: str, y_label: str, seconds: Seconds
) -> Iterator[Check | Series]:
    x = [float(size) for size in seconds]
    y, low, high = ([pick(values) for values in seconds.values()] for pick in (statistics.median, min, max))
    yield Series(f"Seconds against {name}", 0, y_label, x_label, y_label, x, y, low, high)
    slope, *ends = exponent(x, y)
    detail = f"fitted to {x[0]:g} … {x[-1]:g}, range between neighbours; {context.threads} threads"
    fitted = figure(f"growth.{name}.exponent", f"Growth of {y_label} with {x_label}", [slope], "exponent", detail)
    yield structs.replace(fitted, spread=tuple(ends), repeats=len(x) - 1)


def run_seconds(context: SpeedContext, count: int) -> float:
    """Return wall seconds of `count` seeds of small cells through the local executor, with the start of its workers;
    further scenes would cost the same. Raises `RuntimeError` if a cell fails.
    """
    plan = reduced_plan(context)
    size, train, test = (16, 4, 2) if context.quick else (50, 20, 3)
    view_set, out = context.scratch / "growth-views", context.scratch / f"growth-{count}"
    if not view_set.exists():
        write_disc(view_set, size, train, test, seed=0)
    out.mkdir()
    score, budget = replace(plan.score, checkpoints=1), Budget(8 if context.quick else CELL_STEPS, None)
    views = replace(plan.views, resolution=size, train=train, val=0, test=test)
    first = GroupTask("disc", 0, ("nerf",), plan.train, score, budget, out, view_set, views, threads=1)
    tasks = [replace(first, seed=seed) for seed in range(count)]
    began = time.perf_counter()
    cells = [event.cell for event in run_locally(tasks, context.threads) if event.cell]
    seconds = time.perf_counter() - began
    if failed := next((cell for cell in cells if cell.status != "done"), None):
        raise RuntimeError(f"a cell failed: {failed.reason}")
    return seconds
