"""The cost of training and scoring on this machine, from a few steps and views of each method on random colours.

Rays are those of a scene's own cameras, so that as many as usual miss the box; the occupancy grid is filled at random
to its settled share, which a few steps cannot reach.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import torch

from baselines.catalog import CATALOG
from baselines.composition import DENSITY_SCALE
from baselines.contract import Box, Rays
from baselines.methods.explicit import VoxelSettings
from harness.machine.device import keep_freed_memory, use_threads
from harness.plan.profiles import Plan
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.records.metric_table import METRICS
from harness.training.batches import Batches, Cameras
from harness.training.learner import Job, Learner
from harness.training.make_learner import learner_for
from harness.training.scoring import metrics
from harness.training.trainer import Diverged, Trainer
from scenes.files.errors import InputError
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.viewpoints import FOV_X_RADIANS, RADIUS, camera_to_world

OCCUPIED = (0.25, 0.45)
"""The share of the points inside the box that are evaluated once the grid has settled: steps of the eight scenes take
between what these take (`docs/reduced/summary.json`).
"""
SEEN = 0.7
"""The share of these that rendering evaluates: behind a surface nothing is evaluated."""
FEW = 64
"""The rays of a first try."""
LONGEST = 1.5
"""The longest seconds of a measurement: a longer one is extrapolated from fewer rays."""
GROWTH = 8
"""How many times as many rays a next try has. A GPU takes as long for a few rays as for thousands, so that only the
largest try that is short enough is extrapolated.
"""
REPEATS = 3


@dataclass(frozen=True)
class Pace:
    """The seconds, least and most, of one method."""

    first_step: float
    """The seconds of a step before empty space is skipped, the making of its batch included, as in those below."""
    step: tuple[float, float]
    """The seconds of a step afterwards, the grid's refreshes included."""
    ray: tuple[float, float]
    """The seconds per rendered ray."""
    point: float
    """The seconds per point for density without a gradient."""


@dataclass(frozen=True)
class Probe:
    """The measurements for a plan."""

    paces: dict[str, Pace]
    untried: dict[str, str]
    """Map method → why it could not be tried."""
    start: float
    """The seconds until a process is ready for its first step."""
    compared: float
    """The seconds of a view's scores."""
    delayed: float
    """The wall seconds per processor second, while steps and views were timed: 1 if nothing else runs here."""


def probed(plan: Plan, device: torch.device, threads: int) -> Probe:
    """Try every method of `plan`; measures processor seconds if one thread of one works, else wall seconds.

    Methods that differ in their unit of density alone have the same pace.
    """
    use_threads(threads)
    keep_freed_memory()
    clock = time.process_time if device.type == "cpu" and threads == 1 else time.perf_counter
    wall = busy = start = 0.0
    paces: dict[str, Pace] = {}
    untried: dict[str, str] = {}
    alike: dict[Any, str] = {}
    for method in plan.all_methods():
        first = alike.setdefault(_work_of(method), method)
        if first in paces:
            paces[method] = paces[first]
            continue
        try:
            learner = _learner(plan, method, device)
            rays, colours = _batch(plan, FEW, device)
            learner.warm_up(rays, colours)
            start = start or time.process_time()  # this process has done what a worker does first
            began = time.perf_counter(), time.process_time()
            paces[method] = _pace(learner, plan, clock)
            # nothing else is timed: imports wait for the disk, and a child process uses none of our processor time
            wall, busy = wall + time.perf_counter() - began[0], busy + time.process_time() - began[1]
        except (Diverged, InputError, ValueError, TypeError, RuntimeError) as error:
            untried[method] = " ".join(str(error).split())[:200]
    compared = _compared_seconds(plan.views.resolution, clock)
    delayed = wall / busy if clock is time.process_time and busy > 0 else 1.0
    return Probe(paces, untried, start, compared, max(1.0, delayed))


def _work_of(method: str) -> Any:
    """Return a key that is equal for methods whose steps are the same work."""
    parts = CATALOG[method].parts if method in CATALOG else None
    return replace(parts, density_scale=DENSITY_SCALE, density_per="box", start=None) if parts is not None else method


def _learner(plan: Plan, method: str, device: torch.device) -> Learner:
    box = Box(-torch.ones(3, device=device), torch.ones(3, device=device))
    # from its second step on, a budget of one is spent: voxels are then at their finest
    train = replace(plan.train, own=plan.own_settings([method]))
    return learner_for(Job(method, box, train, Budget(1, None), "cost", device))


def _cameras(plan: Plan) -> Cameras:
    poses, width = camera_to_world("train"), plan.views.resolution
    focal = 0.5 * width / np.tan(0.5 * FOV_X_RADIANS)
    return Cameras.of(poses, width, width, float(focal), RADIUS - 2.0, RADIUS + 2.0)


def _batch(plan: Plan, count: int, device: torch.device) -> tuple[Rays, torch.Tensor]:
    """Return rays of random pixels of the training cameras, as batches have them, and colours."""
    generator, cameras = generator_for("cost", count), _cameras(plan)
    most = len(cameras), cameras.width, cameras.height
    view, column, row = (torch.randint(size, (count,), generator=generator) for size in most)
    colours = torch.rand(count, 3, generator=generator)
    return cameras.rays(view, column, row).to(device), colours.to(device)


def _batch_seconds(plan: Plan, learner: Learner, clock: Callable[[], float]) -> float:
    """Return the median seconds of making a batch; of one image, as it takes no longer to read from many."""
    width = plan.views.resolution
    images = ImageStack.of([np.random.default_rng(0).random((width, width, 4), dtype=np.float32)])
    cameras = _cameras(plan).to(learner.device)
    batches = Batches(replace(cameras, camera_to_world=cameras.camera_to_world[:1]), images, plan.train.covered_share)
    batch_at = batches.for_learner(learner.whole_views, "cost", plan.train.rays)
    taken = []
    for step in range(REPEATS + 1):
        began = clock()
        batch_at(step)
        taken.append(clock() - began)
    return float(np.median(taken[1:]))


def _pace(learner: Learner, plan: Plan, clock: Callable[[], float]) -> Pace:
    @cache
    def batch(count: int) -> tuple[Rays, torch.Tensor]:
        return _batch(plan, count, learner.device)

    def step(count: int) -> None:
        learner.train_on(*batch(count))

    def render(count: int) -> None:
        learner.render(batch(count)[0], count)

    made = _batch_seconds(plan, learner, clock)
    first, settings = made + _seconds(step, plan.train.rays, learner.device, clock), plan.train.grid
    if not isinstance(learner, Trainer) or learner.grid is None:
        later = first
        if isinstance(learner, Trainer) and settings.cells and not learner.whole_rays:
            learner.step = settings.first_step + 1  # more bins per ray from then on
            later = made + _seconds(step, plan.train.rays, learner.device, clock)
        ray = _seconds(render, plan.score.chunk, learner.device, clock) / plan.score.chunk
        # voxels are coarser before a share of the budget
        own = plan.own_settings([learner.method]).get(learner.method)
        least = later * (1.0 - own.halves[1]) if isinstance(own, VoxelSettings) else later
        return Pace(first, (least, later), (ray, ray), 0.0)
    grid = learner.grid
    points = max(1, round(settings.share * settings.cells**3))

    def refresh(_: int) -> None:
        grid.refresh(learner.field, settings.share, generator_for("cost"))

    point = _seconds(refresh, FEW, learner.device, clock) / points
    steps, rays = [], []
    for share in OCCUPIED:
        learner.step = settings.first_step + 1
        grid.occupied = _random_mask(share, grid.occupied)
        evaluated = _seconds(step, plan.train.rays, learner.device, clock)
        steps.append(made + evaluated + point * points / settings.every)
        grid.occupied = _random_mask(SEEN * share, grid.occupied)
        rays.append(_seconds(render, plan.score.chunk, learner.device, clock) / plan.score.chunk)
    return Pace(first, (steps[0], steps[1]), (rays[0], rays[1]), point)


def _random_mask(share: float, like: torch.Tensor) -> torch.Tensor:
    return (torch.rand(like.shape, generator=generator_for("cost")) < share).to(like.device)


def _seconds(work: Callable[[int], None], rays: int, device: torch.device, clock: Callable[[], float]) -> float:
    """Return the median seconds of `work` on `rays` rays over a few runs; if that would take long, extrapolated from
    the most that do not.
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
    """Return the seconds of the scores of one view that every checkpoint has."""
    image, truth = np.random.default_rng(0).random((2, width, width, 3), dtype=np.float32)
    for _ in range(2):  # the first call imports
        began = clock()
        for name in METRICS:
            if METRICS[name].compares == "colour":
                getattr(metrics, name)(image, truth)
    return clock() - began
