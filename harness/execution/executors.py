"""The place where cells run: the options, their effect on this machine or a cluster, and the executor of the groups."""

import argparse
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from harness.plan.defaults import KEPT_EVERY
from scenes.files.errors import InputError

if TYPE_CHECKING:
    import torch

    from harness.execution.local_executor import Event
    from harness.plan.group_task import GroupTask
    from harness.plan.profiles import Machine

EXECUTORS = ("local", "ray", "submitit")
MOST_WORKERS = 256


def add_executor_options(command: argparse.ArgumentParser) -> None:
    """Add the options of `run`."""
    add = command.add_argument
    add("--workers", type=int, metavar="N", help="processes on this machine (default: one a core, or one a GPU)")
    add("--threads", type=int, default=1, metavar="N", help="threads of each cell (default: 1)")
    add("--executor", default="local", choices=EXECUTORS, help="where cells run (ray, submitit: optional extras)")
    add(
        "--keep-every", type=float, default=KEPT_EVERY, metavar="S",
        help="seconds between two times that cells are kept in the middle of their training; 0: after every step "
        "(default: %(default)g)",
    )  # fmt: skip
    add("--ray-address", metavar="ADDRESS", help="of a Ray cluster (default: RAY_ADDRESS, else a Ray of this machine)")
    add(
        "--job", action="append", default=[], metavar="NAME=VALUE",
        help="of the jobs of submitit, for example timeout_min=600 or slurm_partition=gpu; may be given again",
    )  # fmt: skip


def device_and_bfloat16(
    options: argparse.Namespace, say: Callable[[str], None] = lambda line: None
) -> "tuple[torch.device, bool]":
    """Return the device that cells train on, and whether it multiplies bfloat16; `options` are those of any command
    with `--device`. The hardware of a cluster is reported.

    Raises `InputError` if the device is not there, or there is no cluster.
    """
    import torch

    from harness.machine.device import chosen_device, multiplies_bfloat16

    executor = getattr(options, "executor", "local")
    if getattr(options, "job", []) and executor != "submitit":
        raise InputError(f"--job {options.job[0]}: goes with --executor submitit alone")
    if executor == "local":
        device = chosen_device(options.device)
        return device, multiplies_bfloat16(device)
    if executor == "submitit":
        from harness.execution.submitit_executor import asked

        beside = options.out.parent if options.out else Path("out")
        name, bfloat16, words = asked(beside, _threads(options), options.device, options.job)
        say(words)
        return torch.device(name), bfloat16
    from harness.execution.cluster.connection import connect, gpus_multiply_bfloat16, hardware

    if options.workers is not None:
        raise InputError("--workers: on Ray the cluster decides how many cells run at once; --threads sets their cores")
    threads = _threads(options)
    say("asking the nodes of the Ray cluster what they have")
    connect(options.ray_address)
    cluster = hardware(threads)
    say(cluster.line())
    for warning in cluster.crowded:
        say(f"warning: {warning}")
    if options.device == "cuda" and not cluster.gpus:
        raise InputError("--device cuda: the Ray cluster offers no GPU; use --device cpu, or start Ray with --num-gpus")
    if options.device == "cpu" or not cluster.gpus:
        return torch.device("cpu"), cluster.bfloat16
    return torch.device("cuda"), gpus_multiply_bfloat16()


def chosen_machine(
    options: argparse.Namespace, device: "torch.device", groups: int, say: Callable[[str], None]
) -> "Machine":
    """Return the machine that `options` and this machine, or the cluster, give `groups`; warns if clocks suffer."""
    import torch

    from harness.machine.cores import physical_cores
    from harness.machine.device import available_cores
    from harness.plan.profiles import Machine

    cores = available_cores()
    if options.workers is not None and not 1 <= options.workers <= MOST_WORKERS:
        raise InputError(f"--workers {options.workers}: must lie between 1 and {MOST_WORKERS}")
    if not 0 <= options.keep_every <= 1e9:
        raise InputError(f"--keep-every {options.keep_every:g}: must lie between 0 and 1e9 seconds")
    threads, keep = _threads(options), options.keep_every
    if options.executor == "ray":
        return Machine(device.type, max(1, cores // threads), threads, "ray", keep)
    if options.executor == "submitit":
        usual = groups if shutil.which("srun") else max(1, cores // threads)
        workers = options.workers or min(usual, groups)
        return Machine(device.type, workers, threads, "submitit", keep, tuple(options.job))
    # hardware threads of one core would slow each other down
    own = min(physical_cores(), cores)
    usual = max(1, own // threads) if device.type == "cpu" else torch.cuda.device_count()
    machine = Machine(device.type, min(options.workers or usual, groups), threads, keep_every=keep)
    for warning in shared_by(machine, own, torch.cuda.device_count() if device.type == "cuda" else 0):
        say(f"warning: {warning}")
    return machine


def shared_by(machine: "Machine", cores: int, gpus: int) -> list[str]:
    """Describe which of the physical `cores` and GPUs timed cells would have to share: their clocks then measure each
    other.
    """
    warnings = []
    if machine.workers * machine.threads > cores:
        warnings.append(
            f"{machine.workers} workers of {machine.threads} threads share {cores} cores; training seconds are not "
            f"comparable (--workers {max(1, cores // machine.threads)}, or fewer --threads)"
        )
    if machine.device == "cuda" and machine.workers > gpus:
        warnings.append(f"{machine.workers} workers share {gpus} GPUs; training seconds are not comparable")
    return warnings


def unused_by(machine: "Machine", cores: int) -> str:
    """Describe the physical `cores` of this machine that cells on its processor leave idle; empty if there are none."""
    idle = cores - machine.workers * machine.threads
    if machine.executor != "local" or machine.device != "cpu" or idle < machine.workers:
        return ""
    return f"; {idle} of {cores} cores idle, --threads {cores // machine.workers} uses more"


def run_groups(
    machine: "Machine", tasks: "list[GroupTask]", commit: str, locally: "Callable[..., Iterator[Event]]"
) -> "Iterator[Event]":
    """Yield events of all groups, run where `machine` has them run."""
    if machine.executor == "ray":
        from harness.execution.ray_executor import run_on_ray

        return run_on_ray(tasks, commit)
    if machine.executor == "submitit":
        from harness.execution.submitit_executor import run_by_submitit

        return run_by_submitit(tasks, commit, machine.workers, list(machine.job_options))
    return locally(tasks, machine.workers)


def device_here(machine: "Machine") -> str:
    """Return the device of work on this machine beside the cells: the head of a cluster may lack their GPU."""
    import torch

    return machine.device if machine.device != "cuda" or torch.cuda.is_available() else "cpu"


def leave() -> None:
    """Leave a cluster that was joined; a Ray that was started for this command ends."""
    if "ray" in sys.modules:
        from harness.execution.cluster.connection import disconnect

        disconnect()


def _threads(options: argparse.Namespace) -> int:
    if not 1 <= options.threads <= 1024:
        raise InputError(f"--threads {options.threads}: must lie between 1 and 1024")
    return int(options.threads)
