"""Question 10: steps per second of the reduced profile, by how the cores are divided."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from harness.machine.device import available_cores
from harness.plan.group_task import GroupTask
from harness.plan.schedule import Budget
from harness.records.study import Check
from harness.studies.speed.growth import ended_cells
from harness.studies.speed.speed_context import SpeedContext, measured, not_measured, ratio, reduced_plan, views_of

STEPS, QUICK_STEPS = 600, 8
MODES = {
    "single": "one process, one thread",
    "threads": "one process, a thread a core",
    "each": "one process a core, one thread each",
}


def measure(context: SpeedContext) -> Iterator[Check]:
    """Train cells through the local executor, as a run does; none of their clocks counts the start of a process."""
    cores = available_cores()
    if context.device.type != "cpu" or cores < 2:
        why = "one core alone" if context.device.type == "cpu" else "a question about CPUs"
        yield not_measured("processes.ratio", "One process a core against one process", "×", why)
        return
    plan, budget = reduced_plan(context), Budget(QUICK_STEPS if context.quick else STEPS, None)
    view_set, score = views_of(context, "lego").path, replace(plan.score, checkpoints=1)
    first = GroupTask("lego", 0, ("nerf",), plan.train, score, budget, Path(), view_set, plan.views)
    rates: dict[str, list[float]] = {name: [] for name in MODES}
    for repetition in range(context.repeats(3)):
        for name, processes, threads in (("single", 1, 1), ("threads", 1, cores), ("each", cores, 1)):
            out = context.scratch / f"processes-{name}-{repetition}"
            out.mkdir()
            tasks = [replace(first, seed=seed, threads=threads, out=out) for seed in range(processes)]
            rates[name].append(sum(cell.steps / cell.train_seconds for cell in ended_cells(tasks, processes)))
    detail = f"reduced settings, nerf on lego, {cores} cores; the first {budget.steps} steps"
    single, threaded, each = (rates[name] for name in MODES)
    title = "One process a core, a thread each, against one process with all threads"
    yield ratio("processes", title, each, threaded, detail)
    title = f"{cores} processes of one thread against one"
    yield ratio("processes.scaling", title, each, single, f"{detail}; {cores} would be perfect")
    title = f"One process with {cores} threads against one with one"
    yield ratio("processes.threads", title, threaded, single, detail)
    for name, words in MODES.items():
        title = f"Training steps of all processes, {words}"
        yield measured(f"processes.{name}.rate", title, rates[name], "steps/s", detail)
