"""The estimated cost of a plan on this machine, from a few steps and views of each method on random colours."""

import math
import time
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from baselines.contract import Box, Rays
from harness.execution.ground_truth import is_cached, rendering_seconds
from harness.execution.progress import SPREAD, Range, span
from harness.machine.device import keep_freed_memory, use_threads
from harness.machine.stopping import in_workers
from harness.machine.stopwatch import Stopwatch
from harness.plan.run_plan import Machine, Plan
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import ViewSettings
from harness.records.cells import WAITED, cell_path, read_cell
from harness.records.metric_table import METRICS
from harness.records.snapshot import ENDED
from harness.training import turns
from harness.training.batches import Batch, Cameras
from harness.training.learner import Job, Learner, take_turn, turns_of
from harness.training.make_learner import learner_for
from harness.training.scoring import metrics
from harness.training.trainer import Diverged, Trainer
from scenes.files.errors import DamagedRecord, InputError
from scenes.view_sets.formats.foreign import source_of
from scenes.view_sets.viewpoints import FOV_X_RADIANS, RADIUS, camera_to_world

OCCUPIED = 0.3
"""The share of the box that the occupancy grid keeps, which a few steps cannot show; scenes differ by `SPREAD`."""
FEW, GROWTH, REPEATS = 64, 8, 3
"""The rays of the first try, the factor of rays from one try to the next, and the number of runs with all rays."""
LONGEST = 1.5
"""The maximum seconds of a measurement; a longer one is extrapolated from fewer rays."""


@dataclass(frozen=True)
class CostEstimate:
    """The estimated wall time of a run."""

    lines: list[str]
    phases: dict[str, Range]
    """Map phase, as in `harness.execution.progress.Progress.expect` → its seconds; empty if not known."""


@dataclass(frozen=True)
class Pace:
    """The seconds of one method per step before it skips empty space, per later step, and per rendered ray."""

    first_step: float
    step: float
    ray: float
    capture: float = 0.0
    """The seconds of compiling and capturing a step, once for each cell."""


@dataclass(frozen=True)
class Paces:
    of: dict[str, Pace]
    untried: dict[str, str]
    """Map method → why it could not be tried."""
    start: float
    """The seconds until a process is ready for its first step."""
    compared: float
    """The seconds of scoring a view."""
    delayed: float
    """The wall seconds per processor second: 1 if nothing else uses the machine."""
    images: int = 0
    """The number of the user's images, each of which a run decodes once."""
    reading: float = 0.0
    """The seconds of decoding them."""


def estimate(plan: Plan, machine: Machine, view_sets: Path, verify: bool, before: Path | None) -> CostEstimate:
    """Measure a few steps and views, and estimate the run; a cluster is not measured. `view_sets` is the cache of
    rendered view sets, `before` the output folder that is resumed. Other processes measure: their memory is not part of
    the run, and a method may crash its process.
    """
    if machine.executor != "local":
        line = "estimated cost: not measured on a cluster; on a node, --dry-run without --executor estimates that node"
        return CostEstimate([line], {})
    measure = partial(measure_paces, plan, torch.device(machine.device), machine.threads)
    calls: list[Callable[[], Any]] = [measure, partial(_missing, plan, view_sets)]
    try:
        paces, missing = in_workers(calls, len(calls))
    except BrokenProcessPool:
        return CostEstimate(["estimated cost: not known, as the process that tried the methods ended"], {})
    if plan.view_set:
        read = [_reading(Path(path), plan.views) for path in plan.view_set]
        paces = replace(paces, images=sum(many for many, _ in read), reading=sum(seconds for _, seconds in read))
    return estimate_from(plan, machine, paces, groups_left(plan, before), missing, verify=verify)


def _reading(path: Path, views: ViewSettings) -> tuple[int, float]:
    """Return the number of images of a view set, and the seconds of decoding them, measured on one image."""
    source, counts = source_of(path), {"train": views.train, "test": views.test}
    files = [file for split in counts if (frames := source.frames(split)) for file in frames.files[: counts[split]]]
    if not files:
        raise InputError(f"{path}: has no training and no test view")
    began = time.process_time()
    source.pixels(files[0], views.resolution)
    return len(files), len(files) * (time.process_time() - began)


def _missing(plan: Plan, view_sets: Path) -> int:
    """Return the number of scenes that are still to be rendered."""
    rendered = () if plan.view_set or plan.scene_file else plan.scenes
    return sum(not is_cached(scene, plan.views, view_sets) for scene in rendered)


def groups_left(plan: Plan, before: Path | None) -> list[tuple[str, ...]]:
    """Return the methods of each group with a cell that has not ended in the output folder `before`, if any."""

    def has_ended(scene: str, method: str, seed: int) -> bool:
        try:
            return before is not None and read_cell(cell_path(before, scene, method, seed)).status in ENDED
        except DamagedRecord:  # or missing
            return False

    groups = plan.groups().items()
    left = [methods for (scene, seed), methods in groups if not all(has_ended(scene, name, seed) for name in methods)]
    # Gaussians that are given take no time
    return left + [() for key in plan.guest_cells() if not has_ended(*key)]


def estimate_from(
    plan: Plan, machine: Machine, paces: Paces, groups: list[tuple[str, ...]], missing: int, *, verify: bool
) -> CostEstimate:
    """Return the estimate for `groups` of cells and `missing` view sets; with `verify`, omissions are measured too."""
    tried = [[paces.of[name] for name in methods if name in paces.of] for methods in groups]
    phases = {
        "rendering": _range(paces.reading) if plan.view_set else rendering_seconds(plan.views, missing),
        "training": on_workers([sum(training_seconds(plan, pace) for pace in group) for group in tried], machine),
        "scoring": on_workers([sum(scoring_seconds(plan, pace, paces) for pace in group) for group in tried], machine),
    }
    start = 2 * paces.start  # for this process and for the workers
    low, high = (start + sum(phase[end] for phase in phases.values()) for end in (0, 1))
    lines = [f"estimated cost: {span(low, high)}"]
    if paces.delayed > WAITED:
        times = f"{paces.delayed:.1f}".removesuffix(".0")
        lines[0] += f" if nothing else ran here; now other programs run, and it takes {times} times as long"
    for name, phase in phases.items():
        length = span(*phase) if phase[1] > 0 else "none"
        if name == "rendering" and plan.view_set:
            lines.append(f"  reading {paces.images} images of yours {length}")
        elif name == "rendering":
            lines.append(f"  {name} {length} ({_where_from(plan, missing)})")
        elif phase[1] > 0:  # the number of test views of a view set is not known yet
            lines.append(f"  {name} {'at most, ' if plan.view_set and name == 'scoring' else ''}{length}")
        if name == "training" and phase[1] > 0:
            each = {method: _range(training_seconds(plan, pace)) for method, pace in paces.of.items()}
            lines += [f"    {method} {span(*seconds)} per cell" for method, seconds in each.items()]
    every = len(plan.groups()) + len(plan.guest_cells())
    if len(groups) < every:
        lines.append(f"  {every - len(groups)} of {every} groups of cells are finished, not included")
    if verify:
        lines.append("  verification of omissions is not included: it trains cells again")
    if plan.scene_file and plan.train.grid.cells and plan.train.accelerations.grid:  # no scene of the catalogue is full
        lines.append("  training and scoring take longer if a medium fills your scene: no empty space is skipped then")
    lines += [f"  {method} is not included: {why}" for method, why in paces.untried.items()]
    cells = [phases["training"][end] + phases["scoring"][end] + start for end in (0, 1)]
    return CostEstimate(lines, {"rendering": phases["rendering"], "training": (cells[0], cells[1])})


def training_seconds(plan: Plan, pace: Pace) -> float:
    # with several threads a core second takes less than a second
    limit = min(plan.budget.seconds or math.inf, plan.budget.core_seconds or math.inf)
    if not plan.budget.steps:
        return limit + pace.capture
    first = min(plan.train.grid.first_step, plan.budget.steps) if plan.train.grid.cells else 0
    return min(first * pace.first_step + (plan.budget.steps - first) * pace.step, limit) + pace.capture


def scoring_seconds(plan: Plan, pace: Pace, paces: Paces) -> float:
    score, views = plan.score, plan.views
    at_checkpoints = score.rendered(views.test)
    rendered = at_checkpoints + score.train_views + 2
    compared = (at_checkpoints + views.test) * paces.compared
    return rendered * views.resolution**2 * pace.ray + compared


def on_workers(groups: list[float], machine: Machine) -> Range:
    """Return the seconds of groups of cells on evenly loaded workers, at least those of the longest group."""
    return _range(max(sum(groups) / machine.workers, max(groups, default=0.0)))


def _range(seconds: float) -> Range:
    return SPREAD[0] * seconds, SPREAD[1] * seconds


def _where_from(plan: Plan, missing: int) -> str:
    if plan.scene_file:
        return "not known beforehand for your own scene, and not included"
    return f"{missing} of {len(plan.scenes)} view sets are not in the cache" if missing else "all view sets are cached"


def measure_paces(plan: Plan, device: torch.device, threads: int) -> Paces:
    """Measure every method of `plan`, in processor seconds on one processor thread, else in wall seconds."""
    use_threads(threads)
    keep_freed_memory()
    clock = time.process_time if device.type == "cpu" and threads == 1 else time.perf_counter
    start, watch = 0.0, Stopwatch(torch.device("cpu"))
    paces: dict[str, Pace] = {}
    untried: dict[str, str] = {}
    box = Box(-torch.ones(3, device=device), torch.ones(3, device=device))
    for method in plan.all_methods():
        try:
            # a budget of one step is spent at the second step, when voxels have their final size
            train = replace(plan.train, own=plan.own_settings([method]))
            learner = learner_for(Job(method, box, train, Budget(1, None), "cost", device))
            learner.warm_up(*_batch(plan, FEW, learner))
            start = start or time.process_time()  # the preparation that each worker needs too
            with watch.running():
                paces[method] = _pace(learner, plan, clock)
        except (Diverged, InputError, ValueError, TypeError, RuntimeError) as error:
            untried[method] = " ".join(str(error).split())[:200]
    delayed = watch.seconds / watch.core_seconds if clock is time.process_time and watch.core_seconds > 0 else 1.0
    return Paces(paces, untried, start, _compared_seconds(plan.views.resolution, clock), max(1.0, delayed))


def _batch(plan: Plan, count: int, learner: Learner) -> tuple[Rays, torch.Tensor]:
    """Return rays through random pixels, as many of which miss the box as usual, and random colours; for a learner of
    whole views the rays are those of one view.
    """
    poses, width, generator = camera_to_world("train"), plan.views.resolution, generator_for("cost", count)
    focal = float(0.5 * width / np.tan(0.5 * FOV_X_RADIANS))
    cameras = Cameras.of(poses, width, width, focal, RADIUS - 2.0, RADIUS + 2.0)
    view, column, row = (torch.randint(size, (count,), generator=generator) for size in (len(cameras), width, width))
    rays = cameras.rays(view[:1].expand(count) if learner.whole_views else view, column, row)
    return rays.to(learner.device), torch.rand(count, 3, generator=generator).to(learner.device)


def _pace(learner: Learner, plan: Plan, clock: Callable[[], float]) -> Pace:
    @cache
    def batch(count: int) -> tuple[Rays, torch.Tensor]:
        return _batch(plan, count, learner)

    def step(count: int) -> None:
        learner.train_on(*batch(count))

    def settled_step(count: int) -> None:
        learner.step = plan.train.grid.first_step + 1  # later bins, and no refresh of the grid
        step(count)

    of_view = plan.views.resolution**2
    rays, chunk = (of_view, of_view) if learner.whole_views else (plan.train.rays, plan.score.chunk)

    def per_ray() -> float:
        return seconds_of(lambda count: learner.render(batch(count)[0], count), chunk, learner.device, clock) / chunk

    if turns_of(learner) is not None:
        pace = _pace_in_turns(learner, lambda step: Batch(*batch(rays)))
        return replace(pace, ray=per_ray())
    first = later = seconds_of(step, rays, learner.device, clock)
    if isinstance(learner, Trainer) and plan.train.grid.cells:
        if learner.grid is not None:
            kept = torch.rand(learner.grid.occupied.shape, generator=generator_for("cost")) < OCCUPIED
            learner.grid.occupied = kept.to(learner.device)
        later = seconds_of(settled_step, rays, learner.device, clock)
    return Pace(first, later, per_ray())


def _pace_in_turns(learner: Learner, batch_at: Callable[[int], Batch]) -> Pace:
    """Return the pace of turns before empty space is skipped, and later, when their capacity has followed."""
    assert isinstance(learner, Trainer)
    first_step = turns.LONGEST
    learner.budget = Budget(10 * first_step, None)
    learner.settings = replace(learner.settings, grid=replace(learner.settings.grid, first_step=first_step))
    paces, captures = [], []
    for _ in range(3):
        began, seconds, step = time.perf_counter(), learner.clock.seconds, learner.step
        take_turn(learner, batch_at)
        paces.append((learner.clock.seconds - seconds) / (learner.step - step))
        captures.append(time.perf_counter() - began - (learner.clock.seconds - seconds))
        if learner.grid is not None and step == 0:
            kept = torch.rand(learner.grid.occupied.shape, generator=generator_for("cost")) < OCCUPIED
            learner.grid.within.copy_(kept)
            learner.grid.occupied.copy_(kept)
            learner.grid.density.copy_(kept)
            learner.step = first_step + 2
    return Pace(paces[0], paces[2], 0.0, max(sum(captures), 0.0))


def seconds_of(work: Callable[[int], object], rays: int, device: torch.device, clock: Callable[[], float]) -> float:
    """Return the median seconds of `work` on `rays` rays; if that takes long, extrapolated from the largest fast try,
    as a GPU takes the same time for a few rays as for thousands.
    """

    def once(count: int) -> float:
        began = clock()
        work(count)
        if device.type == "cuda":
            torch.cuda.synchronize()
        return clock() - began

    count = FEW
    once(count)
    while (taken := once(count)) * GROWTH <= LONGEST and count < rays:
        count = min(GROWTH * count, rays)
    if count < rays:
        return taken * rays / count
    return float(np.median([once(rays) for _ in range(REPEATS)]))


def _compared_seconds(width: int, clock: Callable[[], float]) -> float:
    image, truth = np.random.default_rng(0).random((2, width, width, 3), dtype=np.float32)
    for _ in range(2):  # the first call imports
        began = clock()
        for name in METRICS:
            if METRICS[name].compares == "colour":
                getattr(metrics, name)(image, truth)
    return clock() - began
