"""The options that decide where cells run, and the device and the machine that follow from them."""

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from harness.command.options import Options, option, require_between, require_use
from harness.plan.defaults import KEPT_EVERY
from scenes.files.errors import InputError

if TYPE_CHECKING:
    import torch

    from harness.plan.run_plan import Machine

MACHINE_OPTIONS: Options = {
    "--workers": option("processes on this machine (default: one per core, or one per GPU)", "N", int),
    "--threads": option("threads of each cell (default: 1)", default=1),
    "--executor": option(
        "where cells run (ray, submitit: optional extras)", default="local", choices=("local", "ray", "submitit")
    ),
    "--keep-every": option(
        "seconds between two snapshots of a cell in training; 0: after every step (default: %(default)g)",
        "S",
        float,
        default=KEPT_EVERY,
    ),
    "--ray-address": option("of a Ray cluster (default: RAY_ADDRESS, else start Ray on this machine)", "ADDRESS"),
    "--job": option(
        "parameter of submitit, for example timeout_min=600 or slurm_partition=gpu; may be given several times",
        "NAME=VALUE",
        action="append",
        default=[],
    ),
}


def device_and_bfloat16(
    options: argparse.Namespace, say: Callable[[str], None] = lambda line: None
) -> "tuple[torch.device, bool]":
    """Return the device that cells train on, and whether it has units for bfloat16; reports the hardware of a cluster.
    Raises `InputError` without such a device or cluster.
    """
    import torch

    from harness.machine.device import chosen_device, multiplies_bfloat16

    executor = getattr(options, "executor", "local")
    require_use(options, "with --executor submitit", executor == "submitit", "job")
    require_use(options, "with --executor ray", executor == "ray", "ray_address")
    if executor == "local":
        device = chosen_device(options.device)
        return device, multiplies_bfloat16(device)
    require_between(options, threads=(1, 1024))
    if executor == "submitit":
        from harness.execution.submitit_executor import ask_node

        folder = options.out.parent if options.out else Path("out")
        name, bfloat16, words = ask_node(folder, options.threads, options.device, options.job)
        say(words)
        return torch.device(name), bfloat16
    from harness.execution.cluster.connection import connect, gpus_multiply_bfloat16, hardware

    if options.workers is not None:
        raise InputError("--workers: on Ray the cluster decides how many cells run at once; --threads sets their cores")
    say("asking the nodes of the Ray cluster what they have")
    connect(options.ray_address)
    cluster = hardware(options.threads)
    for line in (cluster.line(), *(f"warning: {warning}" for warning in cluster.crowded)):
        say(line)
    if options.device == "cuda" and not cluster.gpus:
        raise InputError("--device cuda: the Ray cluster offers no GPU; use --device cpu, or start Ray with --num-gpus")
    if options.device == "cpu" or not cluster.gpus:
        return torch.device("cpu"), cluster.bfloat16
    return torch.device("cuda"), gpus_multiply_bfloat16()


def chosen_machine(
    options: argparse.Namespace, device: "torch.device", groups: int, say: Callable[[str], None]
) -> "Machine":
    """Return the part of this machine or the cluster that a run of `groups` uses; warns if timed cells share cores."""
    import torch

    from harness.machine.cores import physical_cores
    from harness.machine.device import available_cores
    from harness.plan.run_plan import Machine

    require_between(options, workers=(1, 256), threads=(1, 1024), keep_every=(0, 1e9))
    cores, threads, keep = available_cores(), options.threads, options.keep_every
    if options.executor == "ray":
        return Machine(device.type, max(1, cores // threads), threads, "ray", keep)
    if options.executor == "submitit":
        usual = groups if shutil.which("srun") else max(1, cores // threads)
        workers = options.workers or min(usual, groups)
        return Machine(device.type, workers, threads, "submitit", keep, tuple(options.job))
    # hardware threads of one core would slow each other down
    own = min(physical_cores(), cores)
    gpus = torch.cuda.device_count() if device.type == "cuda" else 0
    usual = gpus if device.type == "cuda" else max(1, own // threads)
    machine = Machine(device.type, min(options.workers or usual, groups), threads, keep_every=keep)
    for warning in shared_by(machine, own, gpus):
        say(f"warning: {warning}")
    return machine


def shared_by(machine: "Machine", cores: int, gpus: int) -> list[str]:
    """Return warnings on the physical `cores` and GPUs that timed cells would share."""
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
    """Describe the physical `cores` of this machine that the cells leave idle; empty if there are none."""
    idle = cores - machine.workers * machine.threads
    if machine.executor != "local" or machine.device != "cpu" or idle < machine.workers:
        return ""
    return f"; {idle} of {cores} cores idle, --threads {cores // machine.workers} uses more"
