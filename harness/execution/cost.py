"""The estimated cost of a plan on this machine, as a range; printed before anything is done."""

import math
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.execution.ground_truth import MEGASAMPLE, MEGASAMPLE_CORES, SCALAR_MEGASAMPLE, is_cached
from harness.execution.progress import Range, span
from harness.machine.stopping import in_workers
from harness.plan.profiles import Machine, Plan
from harness.records.cells import WAITED, cell_path, read_cell
from harness.records.json_record import DamagedRecord
from harness.records.snapshot import ENDED
from scenes.rendering.variant import llvm_libraries

if TYPE_CHECKING:
    from harness.execution.probe import Pace, Probe

SERVED_VIEWS = 1000
"""The views rendered to measure view cache and attention at the end of a run."""
BESIDE = (1.0, 1.3)
"""The overhead factor for reading views, writing records and pictures, and scores of the last checkpoint alone."""
HISTOGRAM_POINTS = 32**3
PROPERTY_POINTS = 48**3


@dataclass(frozen=True)
class Extent:
    """The part of a plan that is still to be done, and what is done besides."""

    missing: int
    """The number of view sets of the catalogue that are not in the cache."""
    groups: tuple[tuple[str, ...], ...]
    """The methods of each group that lacks a cell."""
    verify: bool
    """Whether omissions are tried with and without."""
    serving: bool
    """Whether view cache and attention are measured at the end."""


@dataclass(frozen=True)
class CostEstimate:
    """The estimated wall time of a run."""

    lines: list[str]
    """In words, by phase."""
    phases: dict[str, Range]
    """Map phase, as `harness.execution.progress.Progress.expect` names it, → its seconds; empty if not known."""


def estimate(
    plan: Plan, machine: Machine, view_sets: Path, verify: bool, serving: bool, before: Path | None
) -> CostEstimate:
    """Measure a few steps and views, and estimate the run; a cluster is not measured.

    `view_sets` is the cache of rendered ones, `before` the output folder that is resumed.
    """
    if machine.executor != "local":
        words = "estimated cost: a cluster is not measured beforehand; docs/scaling.md says how to compute it"
        return CostEstimate([words], {})
    import torch

    from harness.execution.probe import probed
    from harness.machine.device import available_cores

    probe = probed(plan, torch.device(machine.device), machine.threads)
    rendered = () if plan.view_set or plan.scene_file else plan.scenes
    missing = sum(not is_cached(scene, plan.views, view_sets) for scene in rendered)
    extent = Extent(missing, groups_left(plan, before), verify, serving)
    return estimated(plan, machine, probe, extent, available_cores(), bool(llvm_libraries()))


def estimate_apart(*arguments: Any) -> CostEstimate:
    """Return `estimate` from a process of its own: what it loads is no part of the run, and a method may end it."""
    try:
        (found,) = in_workers([partial(estimate, *arguments)], workers=1)
    except BrokenProcessPool:
        return CostEstimate(["estimated cost: not known, as the process that tried the methods ended"], {})
    return found


def groups_left(plan: Plan, before: Path | None) -> tuple[tuple[str, ...], ...]:
    """Return the methods of each group of which an output folder lacks a cell that has ended; all without a folder."""

    def is_there(scene: str, method: str, seed: int) -> bool:
        path = cell_path(before, scene, method, seed) if before is not None else None
        try:
            return path is not None and path.exists() and read_cell(path).status in ENDED
        except DamagedRecord:
            return False

    # a guest takes as long as the baseline
    guests = [(plan.roles.among(plan.methods).baseline,) for key in plan.guest_cells() if not is_there(*key)]
    groups = plan.groups().items()
    left = [methods for (scene, seed), methods in groups if not all(is_there(scene, name, seed) for name in methods)]
    return (*left, *guests)


def estimated(
    plan: Plan, machine: Machine, probe: "Probe", extent: Extent, cores: int, compiled: bool = True
) -> CostEstimate:
    """Return the estimate from measurements on a machine of so many `cores`, which has LLVM for Mitsuba or not."""
    paces = [probe.paces[name] for name in plan.methods if name in probe.paces]
    groups = [[probe.paces[name] for name in methods if name in probe.paces] for methods in extent.groups]
    phases = {
        "rendering": rendering_seconds(plan, extent.missing, cores, compiled),
        "training": shared([[training_seconds(plan, pace) for pace in group] for group in groups], machine),
        "scoring": shared([[scoring_seconds(plan, pace, probe) for pace in group] for group in groups], machine),
    }
    # this process and the workers, one after the other
    low, high = (2 * probe.start + sum(phase[end] for phase in phases.values()) for end in (0, 1))
    if extent.serving:
        name = "view cache and attention"
        phases[name] = serving_seconds(plan, paces, (low, high))
        low, high = low + phases[name][0], high + phases[name][1]
    at_most = {"scoring"} if plan.view_set else set()  # the number of test views was not read
    notes = {"rendering": _where_from(plan, extent.missing)}
    lines = [f"estimated cost: {span(low, high)}"]
    if probe.delayed > WAITED:
        lines[0] += " if nothing else ran here; now others use this machine, and it takes "
        lines[0] += f"{probe.delayed:.1f}".removesuffix(".0") + " times as long"
    for name, phase in phases.items():
        if phase[1] > 0 or name in notes:
            length = span(*phase) if phase[1] > 0 else "none"
            most = "at most, " if name in at_most else ""
            note = f" ({notes[name]})" if notes.get(name) else ""
            lines.append(f"  {name} {most}{length}{note}")
    every = len(plan.groups()) + len(plan.guest_cells())
    if len(groups) < every:
        lines.append(f"  {every - len(groups)} of {every} groups of cells are finished, not in it")
    if extent.verify:
        lines.append("  verification of omissions is not in it: it trains cells again")
    if plan.scene_file and plan.train.grid.cells and plan.train.accelerations.grid:  # none of the catalogue is full
        lines.append("  training and scoring take longer if a medium fills your scene: no empty space is left out then")
    lines += [f"  {method} is not in it: {why}" for method, why in probe.untried.items()]
    in_cells = [phases["training"][end] + phases["scoring"][end] + 2 * probe.start for end in (0, 1)]
    by_bar = {"rendering": phases["rendering"], "training": (in_cells[0], in_cells[1])}
    if extent.serving:
        by_bar["part"] = phases["view cache and attention"]
    return CostEstimate(lines, by_bar)


def training_seconds(plan: Plan, pace: "Pace") -> Range:
    """Return the training seconds of a cell, on its own clock."""
    # of one thread a core second is a second, and of several fewer
    most = min(plan.budget.seconds or math.inf, plan.budget.core_seconds or math.inf)
    if not plan.budget.steps:
        return most, most
    first = min(plan.train.grid.first_step, plan.budget.steps) if plan.train.grid.cells else 0
    low, high = (first * pace.first_step + (plan.budget.steps - first) * step for step in pace.step)
    return min(low, most), min(high, most)


def scoring_seconds(plan: Plan, pace: "Pace", probe: "Probe") -> Range:
    """Return the scoring seconds of a cell: its checkpoints, and the measurements made once at its end."""
    score, views = plan.score, plan.views
    rendered = score.checkpoints * views.test + score.train_views + 2
    points = score.checkpoints * HISTOGRAM_POINTS + PROPERTY_POINTS
    compared = (score.checkpoints + 1) * views.test * probe.compared + points * pace.point
    low, high = (rendered * views.resolution**2 * ray + compared for ray in pace.ray)
    return low, high


def shared(groups: list[list[Range]], machine: Machine) -> Range:
    """Return the seconds of groups of cells on the machine's workers, each of which does one group after the other.

    At best they are evenly loaded, and no sooner done than the longest group; at worst the longest one begins when all
    others are done (Graham's bound of list scheduling).
    """
    least, most = ([sum(cell[end] for cell in group) for group in groups] for end in (0, 1))
    even = sum(least) / machine.workers
    late = (sum(most) - max(most, default=0.0)) / machine.workers + max(most, default=0.0)
    return BESIDE[0] * max(even, max(least, default=0.0)), BESIDE[1] * late


def rendering_seconds(plan: Plan, missing: int, cores: int, compiled: bool = True) -> Range:
    """Return the rendering seconds on all cores, at best that much faster than on those of the measurement, or slower
    on fewer.
    """
    scale, megasample = MEGASAMPLE_CORES / cores, MEGASAMPLE if compiled else SCALAR_MEGASAMPLE
    of_a_scene = mean_of(max(missing, 1), plan.views.samples())
    low, high = (missing * samples * plan.views.resolution**2 / 1e6 for samples in of_a_scene)
    return scale * megasample[0] * low, max(scale, 1.0) * megasample[1] * high


def mean_of(count: int, each: Range) -> Range:
    """Return the range of the mean of so many, of which each lies within a range: the few extreme ones make up for
    each other.
    """
    middle, half = (each[0] + each[1]) / 2, (each[1] - each[0]) / 2
    return middle - half / math.sqrt(count), middle + half / math.sqrt(count)


def serving_seconds(plan: Plan, paces: "list[Pace]", run: Range) -> Range:
    """Return the seconds of serving after a run of so many seconds, a share of which it may take; 0 if it would take
    longer.
    """
    from harness.plan.defaults import SERVING_SECONDS, SERVING_SHARE, SERVING_WIDTH

    rays = SERVED_VIEWS * min(SERVING_WIDTH, plan.views.resolution) ** 2
    low, high = (max((pace.ray[end] for pace in paces), default=0.0) * rays for end in (0, 1))
    least, most = (max(SERVING_SECONDS, SERVING_SHARE * seconds) for seconds in run)
    return (0.0 if high > least else low), min(high, most)


def _where_from(plan: Plan, missing: int) -> str:
    if plan.view_set:
        return "the images are yours"
    if plan.scene_file:
        return "that of a scene of your own is not known beforehand, and not in it"
    return f"{missing} of {len(plan.scenes)} view sets are not in the cache" if missing else "all view sets are cached"
