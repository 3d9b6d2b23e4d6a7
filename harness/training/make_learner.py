"""The factory of learners: creates the learner of a method, or reports why this machine cannot train it."""

import importlib.util
import os
from pkgutil import resolve_name
from typing import Literal

import torch

from harness.plan.plugins import method_named
from harness.training.learner import Job, Learner
from harness.training.turns import in_turns
from scenes.files.errors import InputError
from scenes.rendering.variant import OLDEST_LLVM, llvm_libraries, probe


class NotAvailable(InputError):
    """A method that this machine cannot train; the message says what is missing. In a comparison its cells end as
    `not_available`; a command about only this method ends with the message.
    """


def learner_for(job: Job) -> Learner:
    """Return the method ready to be trained. Raises `NotAvailable` if this machine cannot train it, and `InputError` if
    the user's package that offers it cannot be loaded.
    """
    trainer = method_named(job.method).trainer
    try:
        make = resolve_name(trainer) if isinstance(trainer, str) else trainer
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"{job.method}: its trainer {trainer} cannot be imported: {error}") from error
    made: Learner = make(job)
    return in_turns(made) if job.device.type == "cuda" else made


def splats(job: Job) -> Learner:
    if job.device.type != "cpu":
        raise NotAvailable("is drawn only by the processor; --device cpu trains it")
    from harness.training.kinds.splat_trainer import SplatTrainer

    return SplatTrainer(job)


def given_splats(job: Job) -> Learner:
    if job.device.type != "cpu":
        raise NotAvailable("is drawn only by the processor; --device cpu scores it")
    from harness.training.kinds.given_splats import GivenSplats

    return GivenSplats(job)


def ellipsoids(job: Job) -> Learner:
    if drjit_backend(job.device) != "llvm" or importlib.util.find_spec("mitsuba") is None:
        raise NotAvailable("is traced by Mitsuba on the processor; --device cpu trains it")
    from harness.training.kinds.ellipsoid_trainer import EllipsoidTrainer

    return EllipsoidTrainer(job)


def voxels(job: Job) -> Learner:
    backend = drjit_backend(job.device)
    from harness.training.kinds.voxel_trainer import VoxelTrainer

    return VoxelTrainer(job, backend)


def drjit_backend(device: torch.device) -> Literal["llvm", "cuda"]:
    """Return Dr.Jit's backend for `device`, tested in another process, as it may abort. Raises `NotAvailable`."""
    if importlib.util.find_spec("drjit") is None:
        raise NotAvailable("needs the package drjit, which is not installed")
    if device.type == "cuda" and torch.version.hip:
        raise NotAvailable("Dr.Jit has no backend for ROCm; --device cpu trains it with LLVM")
    if device.type == "cuda":
        if (failure := probe("cuda_ad_rgb", "")) is not None:
            raise NotAvailable(f"Dr.Jit's CUDA backend does not work here: {failure}")
        return "cuda"
    failures = []
    for library in map(str, llvm_libraries()):
        failure = probe("llvm_ad_rgb", library)
        if failure is None:
            os.environ["DRJIT_LIBLLVM_PATH"] = library
            return "llvm"
        failures.append(f"{library} failed: {failure}")
    raise NotAvailable(
        f"needs the shared library of LLVM {OLDEST_LLVM} or newer for Dr.Jit: "
        f"{'; '.join(failures) or 'none was found'}; install one (Debian: libllvm19) or name it in DRJIT_LIBLLVM_PATH"
    )
