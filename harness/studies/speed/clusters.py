"""Question 12: what a Ray cluster costs, against the same worker processes without it on the same cores."""

import contextlib
import io
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from harness.execution.group_loop import Event
from harness.execution.local_executor import run_locally
from harness.machine.cores import physical_cores
from harness.plan.group_task import GroupTask
from harness.plan.run_plan import Machine
from harness.plan.schedule import Budget
from harness.records.cells import read_cells
from harness.records.study import Check
from harness.studies.speed.speed_context import (
    SCENE,
    SpeedContext,
    figure,
    no_figure,
    ratio,
    reduced_plan,
    views_of,
)

GROUPS_PER_CORE = 2
STEPS, QUICK_STEPS = 500, 4
TITLE = "Training steps per second: Ray with one node per core, against the same number of processes without Ray"
LEAST = 0.95


def measure(context: SpeedContext) -> Iterator[Check]:
    if context.device.type != "cpu" or physical_cores() < 2:
        yield no_figure("cluster.ratio", TITLE, "×", "a question about several cores of a CPU", low=LEAST)
        return
    try:
        import ray  # noqa: F401
    except ImportError:
        yield no_figure("cluster.ratio", TITLE, "×", "Ray is not installed (the extra `ray`)", low=LEAST)
        return
    from harness.execution.ray_executor import run_on_ray

    cores = min(physical_cores(), 3)
    rates: dict[str, list[float]] = {"ray": [], "local": []}
    with _cluster(cores):
        sides: dict[str, Callable[[list[GroupTask]], Iterator[Event]]] = {
            "ray": lambda tasks: run_on_ray(tasks, "none"),
            "local": lambda tasks: run_locally(tasks, cores),
        }
        for repetition in range(-1, context.repeats(2)):
            for name, side in sides.items():
                rate = _rate(context, side, cores, brief=repetition < 0)
                if repetition >= 0:  # in the first round sources are sent and workers start
                    rates[name].append(rate)
    steps = QUICK_STEPS if context.quick else STEPS
    detail = f"reduced settings, nerf on lego, {GROUPS_PER_CORE * cores} groups of {steps} steps on {cores} cores"
    yield ratio("cluster", TITLE, rates["ray"], rates["local"], detail, low=LEAST)
    for name, words in (("ray", "Ray"), ("local", "processes of this machine")):
        yield figure(f"cluster.{name}.rate", f"Training steps of all groups, {words}", rates[name], "steps/s", detail)


def _rate(context: SpeedContext, side: Callable[[list[GroupTask]], Iterator[Event]], cores: int, brief: bool) -> float:
    """Return the training steps per wall second, with all other work on a group included."""
    steps = QUICK_STEPS if context.quick or brief else STEPS
    plan = replace(
        reduced_plan(context), seeds=tuple(range(GROUPS_PER_CORE * cores)), budget=Budget(steps, None), extras=()
    )
    folders = {SCENE: views_of(context).path}
    with tempfile.TemporaryDirectory(dir=context.scratch) as out:
        tasks = plan.tasks(folders, Machine("cpu", cores, 1), Path(out))
        began = time.perf_counter()
        for _ in side(tasks):
            pass
        seconds = time.perf_counter() - began
        done = sum(cell.steps for cell in read_cells(Path(out)) if cell.status == "done")
    if done != steps * len(tasks):
        raise RuntimeError(f"only {done} of {steps * len(tasks)} steps were trained")
    return done / seconds


@contextmanager
def _cluster(cores: int) -> Iterator[None]:
    """Start and join a Ray cluster: a head that trains nothing, and per core a node with its own temporary folder."""
    from ray.cluster_utils import Cluster

    from harness.execution.cluster.connection import connect, disconnect

    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        with contextlib.redirect_stderr(io.StringIO()):
            cluster = Cluster()
            cluster.add_node(num_cpus=0, include_dashboard=False, wait=False)
            for number in range(cores):
                own = Path(scratch) / f"node{number}"
                own.mkdir()
                cluster.add_node(num_cpus=1, env_vars={"TMPDIR": str(own)}, wait=False)
            cluster.wait_for_nodes()
        try:
            connect(cluster.address)
            yield
        finally:
            disconnect()
            cluster.shutdown()
