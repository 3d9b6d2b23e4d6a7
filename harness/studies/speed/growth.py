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
from harness.studies.speed.speed_context import (
    DENSE,
    Seconds,
    SpeedContext,
    interleaved,
    measured,
    reduced_plan,
    synthetic_batch,
    trained_reduced,
)
from harness.studies.speed.throughput import dense_side
from harness.training.batches import Cameras
from harness.training.evaluate import render_view

RAYS, SAMPLES, WIDTHS = (128, 256, 512, 1024, 2048), (16, 32, 64, 128), (32, 64, 128, 256, 512)
RESOLUTIONS = (50, 71, 100, 141, 200)
SCENES, SEEDS = (1, 2, 4, 8), (1, 2, 4)
CELL_STEPS = 400


def measure(situation: SpeedContext) -> Iterator[Check | Series]:
    steps: tuple[tuple[str, tuple[int, ...], Callable[[TrainSettings, int], TrainSettings], str], ...] = (
        ("rays", RAYS, lambda base, size: replace(base, rays=size), "rays a step"),
        ("samples", SAMPLES, lambda base, size: replace(base, bins=size, first_bins=size), "samples a ray"),
        ("width", WIDTHS, lambda base, size: replace(base, network=replace(base.network, width=size)), "layer width"),
    )
    for name, sizes, settings_at, label in steps:
        chosen = sizes[:3] if situation.quick else sizes
        sides = {size: _step(situation, settings_at(dense_reduced(situation), size)) for size in chosen}
        yield from _reported(situation, name, label, "s a training step", _timed(situation, sides))
    trainer = trained_reduced(situation)
    chunk = reduced_plan(situation).score.chunk
    views: dict[int, Callable[[], object]] = {}
    for size in (8, 12, 16) if situation.quick else RESOLUTIONS:
        focal = 0.5 * size / math.tan(0.5 * FOV_X_RADIANS)
        cameras = Cameras.of(poses(3, 0.5), size, size, focal, 2.0, 6.0).to(situation.device)
        views[size] = partial(render_view, trainer, cameras, 1, chunk)
    yield from _reported(situation, "resolution", "width of a view (px)", "s a view", _timed(situation, views))
    if situation.device.type == "cpu":
        runs = (("seeds", SEEDS[:2]),) if situation.quick else (("scenes", SCENES), ("seeds", SEEDS))
        for name, counts in runs:
            wall = {count: [run_seconds(situation, name, count)] for count in counts}
            yield from _reported(situation, name, f"{name} of a run", "wall seconds of a run", wall)


def dense_reduced(situation: SpeedContext) -> TrainSettings:
    """Return the reduced profile's step with every sample evaluated, so that work is exactly proportional to
    samples.
    """
    settings = reduced_plan(situation).train
    return replace(settings, first_bins=settings.bins, grid=GridSettings(cells=0), accelerations=DENSE)


def _step(situation: SpeedContext, settings: TrainSettings) -> Callable[[], object]:
    return dense_side(situation, settings, synthetic_batch(situation, settings.rays))


def _timed(situation: SpeedContext, sides: dict[int, Callable[[], object]]) -> dict[int, list[float]]:
    named = {str(size): side for size, side in sides.items()}
    least = 0.0 if situation.quick else 0.1
    seconds: Seconds = interleaved(named, situation.repeats(5), situation.synchronise, least)
    return {size: seconds[str(size)] for size in sides}


def exponent(x: list[float], y: list[float]) -> tuple[float, float, float]:
    """Return the slope of log y over log x: fitted, and the smallest and largest between neighbours."""
    log_x, log_y = np.log(x), np.log(y)
    between = np.diff(log_y) / np.diff(log_x)
    return float(np.polyfit(log_x, log_y, 1)[0]), float(between.min()), float(between.max())


def _reported(
    situation: SpeedContext, name: str, x_label: str, y_label: str, seconds: dict[int, list[float]]
) -> Iterator[Check | Series]:
    x = [float(size) for size in seconds]
    y = [statistics.median(values) for values in seconds.values()]
    yield Series(
        panel=f"Seconds against {name}",
        item=0,
        name=y_label,
        x_label=x_label,
        y_label=y_label,
        x=x,
        y=y,
        low=[min(values) for values in seconds.values()],
        high=[max(values) for values in seconds.values()],
    )
    slope, low, high = exponent(x, y)
    fitted = measured(
        f"growth.{name}.exponent",
        f"Growth of {y_label} with {x_label}",
        [slope],
        "exponent",
        detail=f"fitted to {x[0]:g} … {x[-1]:g}, range between neighbours; {situation.threads} threads",
    )
    yield structs.replace(fitted, spread=(low, high), repeats=len(x) - 1)


def run_seconds(situation: SpeedContext, what: str, count: int) -> float:
    """Return wall seconds of `count` scenes or seeds of small cells through the local executor, workers' start
    included.
    """
    plan = reduced_plan(situation)
    size, train, test = (16, 4, 2) if situation.quick else (50, 20, 3)
    views = situation.scratch / "growth-views"
    if not views.exists():
        write_disc(views, size, train, test, seed=0)
    steps = 8 if situation.quick else CELL_STEPS
    out = situation.scratch / f"growth-{what}-{count}"
    out.mkdir()
    tasks = [
        GroupTask(
            scene=f"scene{index if what == 'scenes' else 0}",
            seed=index if what == "seeds" else 0,
            methods=("nerf",),
            view_set=views,
            views=replace(plan.views, resolution=size, train=train, val=0, test=test),
            train=plan.train,
            score=replace(plan.score, checkpoints=1),
            budget=Budget(steps, None),
            device="cpu",
            threads=1,
            out=out,
        )
        for index in range(count)
    ]
    began = time.perf_counter()
    failed = [
        event.cell for event in run_locally(tasks, situation.threads) if event.cell and event.cell.status == "error"
    ]
    if failed:
        raise RuntimeError(f"a cell failed: {failed[0].reason}")
    return time.perf_counter() - began
