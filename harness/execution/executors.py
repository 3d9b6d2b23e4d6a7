"""Chooses the executor of the groups of cells: this machine, a Ray cluster, or Slurm by submitit."""

import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.execution.ground_truth import Arriving
    from harness.execution.group_loop import Event
    from harness.plan.group_task import GroupTask
    from harness.plan.run_plan import Machine


def run_groups(
    machine: "Machine",
    tasks: "list[GroupTask]",
    commit: str,
    locally: "Callable[..., Iterator[Event]]",
    arriving: "Arriving | None",
) -> "Iterator[Event]":
    """Run all tasks; on this machine also those that are `arriving`."""
    if machine.executor == "ray":
        from harness.execution.ray_executor import run_on_ray

        return run_on_ray(tasks, commit)
    if machine.executor == "submitit":
        from harness.execution.submitit_executor import run_by_submitit

        return run_by_submitit(tasks, commit, machine.workers, list(machine.job_options))
    return locally(tasks, machine.workers, *([arriving] if arriving else []))


def device_here(machine: "Machine") -> str:
    """Return the device of work on this machine other than cells: the head of a cluster may lack their GPU."""
    import torch

    return machine.device if machine.device != "cuda" or torch.cuda.is_available() else "cpu"


def leave() -> None:
    """Leave the joined cluster, if there is one; a Ray that was started for this command ends."""
    if "ray" in sys.modules:
        from harness.execution.cluster.connection import disconnect

        disconnect()
