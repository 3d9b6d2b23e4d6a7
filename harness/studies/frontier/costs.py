"""The cost of a trained model: learnt numbers, bytes, time to draw a view, and the budget that reaches a score."""

import statistics
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from harness.machine.device import use_threads
from harness.plan.group_task import GroupTask
from harness.plan.run_plan import Plan
from harness.plan.schedule import Budget
from harness.playback.run_loader import FinishedRun, TrainedCell
from harness.records.study import Table
from harness.studies.framework import Found, Rows
from harness.studies.frontier.frontier_context import CORE_SECONDS, Frontier, FrontierContext
from harness.studies.speed.memory import peaks_of
from harness.studies.trained_context import folder_of
from harness.training.checkpoints import checkpoint_path
from harness.verdicts.failures import exact_interval

ROUNDS = {100: 3, 400: 1}
"""Width of the view in pixels → number of drawings, of which the median counts."""
MEMORY_STEPS = 60
"""The number of steps with an occupancy grid before the peak of memory is read."""
TARGETS = (25.0, 28.0, 30.0)


def costs(context: FrontierContext) -> Iterator[Found]:
    frontier = context.frontier()
    last, scene, seed = frontier.budgets[-1], frontier.amount.scenes[-1], frontier.amount.seeds[0]
    families = [
        family
        for family in frontier.trained
        if any((cell.scene, cell.seed) == (scene, seed) for cell in frontier.of(last, family))
    ]
    if not families:
        yield f"No family has a model of {scene} at {last:g} core seconds: nothing was measured."
        return
    name, machine = f"{CORE_SECONDS}{last:g}", context.machine
    run = FinishedRun.of(folder_of(context.out, name))
    (record,) = run.scenes([scene])
    views = run.views(record, context.view_sets, geometry=False, scratch=context.scratch)
    use_threads(machine.workers * machine.threads)  # nothing else runs meanwhile
    try:
        drawn = {
            family: drawing(run.trained(record, family, seed, context.device), views.test.camera_to_world[0])
            for family in families
        }
    finally:
        use_threads(machine.threads)
    quickest = min(drawn, key=lambda family: drawn[family][1])
    per_second = 1.0 / drawn[quickest][1]
    yield (
        f"{quickest} draws a view fastest: {per_second:.3g} views of {max(ROUNDS)} pixels per second on "
        f"{machine.workers * machine.threads} threads."
    )
    rows: Rows = []
    for family in families:
        cells = frontier.of(last, family)
        numbers = np.median([cell.parameters["total"] for cell in cells])
        size = np.median([checkpoint_path(run.out, c.scene, c.method, c.seed).stat().st_size for c in cells])
        ended = [cell for budget in frontier.budgets for cell in frontier.cells[budget] if cell.method == family]
        lost = len(ended) - sum(len(frontier.of(budget, family)) for budget in frontier.budgets)
        low, high = exact_interval(lost, len(ended))
        geometry = [frontier.mean(last, family, name) for name in ("depth_rmse", "opacity_iou")]
        sizes = [f"{numbers:,.0f}", f"{size / 1e6:.2f}", *(f"{1e3 * seconds:.0f}" for seconds in drawn[family])]
        memory = f"{peak(context, context.plan(name), views.path, family) / 1e9:.2f}"
        failed = f"{lost} of {len(ended)} ({100 * low:.0f} to {100 * high:.0f} %)"
        rows.append([family, *sizes, memory, *geometry, failed])
    columns = ["family", "learnt numbers", "MB on disk", *(f"ms per view, {width} px" for width in ROUNDS)]
    columns += ["peak memory of a worker, GB", "depth RMSE", "opacity IoU", "failed (95 % of the rate)"]
    yield Table("costs", 0, f"Models of {last:g} core seconds; a view of {scene}", columns, rows)
    yield time_to_score(frontier)


def drawing(cell: TrainedCell, camera_to_world: np.ndarray) -> list[float]:
    camera = cell.camera(camera_to_world)
    seconds = []
    cell.learner.render(camera.resized(16).rays(cell.learner.device), cell.chunk)  # kernels are compiled here
    for width, rounds in ROUNDS.items():
        rays = camera.resized(width).rays(cell.learner.device)
        times = []
        for _ in range(rounds):
            began = time.perf_counter()
            cell.learner.render(rays, cell.chunk)
            times.append(time.perf_counter() - began)
        seconds.append(statistics.median(times))
    return seconds


def peak(context: FrontierContext, plan: Plan, view_set: Path, family: str) -> int:
    """Return the peak bytes, with libraries, of a fresh process that trains a cell for a few steps and scores it."""
    budget = Budget(plan.train.grid.first_step + MEMORY_STEPS, None)
    task = GroupTask("memory", 0, (family,), plan.train, plan.score, budget, context.scratch, view_set, plan.views)
    return peaks_of(context, task)[1]


def time_to_score(frontier: Frontier) -> Table:
    rows: Rows = []
    for family in frontier.trained:
        entries = []
        scores = np.array([frontier.table(budget, (family,))[0] for budget in frontier.budgets])
        for target in TARGETS:
            first = np.where(scores >= target, np.array(frontier.budgets)[:, None], np.inf).min(axis=0)
            middle = float(np.median(first))
            when = f"{middle:g}" if np.isfinite(middle) else f"> {frontier.budgets[-1]:g}"
            entries.append(f"{when} ({np.isfinite(first).sum()} of {len(first)} scenes)")
        rows.append([family, *entries])
    title = "Core seconds to a score: the median over scenes of the shortest budget that reaches it"
    return Table("time_to_score", 0, title, ["family", *(f"{target:g} dB" for target in TARGETS)], rows)
