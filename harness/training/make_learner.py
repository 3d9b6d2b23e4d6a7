"""The factory of learners: makes the right learner for a method, or reports why this machine cannot train it."""

import importlib.util
import os
from typing import Literal

import torch

from baselines.contract import Box
from harness.plan.plugins import method_named
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.training.learner import Learner
from harness.training.trainer import Trainer
from scenes.files.errors import InputError
from scenes.rendering.variant import OLDEST_LLVM, llvm_libraries, probe


class NotAvailable(InputError):
    """A method that this machine cannot train. The message says what is missing.

    In a comparison its cells end as `not_available`; a command about this method alone ends with the message.
    """


def learner_for(
    method: str,
    box: Box,
    settings: TrainSettings,
    budget: Budget,
    seed: int | str,
    device: torch.device,
    view_dependent: bool = True,
) -> Learner:
    """Return the method ready to be trained. Raises `NotAvailable` if this machine lacks what it needs, and
    `InputError` if a user's own package that offers it cannot be loaded.
    """
    given = method, box, settings, budget, seed, device, view_dependent
    kind = method_named(method).kind
    if kind == "network":
        return Trainer(*given)
    if kind == "splats":
        if device.type != "cpu":
            raise NotAvailable("is drawn by the processor alone; --device cpu trains it")
        from harness.training.kinds.splat_trainer import SplatTrainer

        return SplatTrainer(*given)
    backend = drjit_backend(device)
    if kind == "ellipsoids":
        if backend != "llvm" or importlib.util.find_spec("mitsuba") is None:
            raise NotAvailable("is traced by Mitsuba on the processor; --device cpu trains it")
        from harness.training.kinds.ellipsoid_trainer import EllipsoidTrainer

        return EllipsoidTrainer(*given)
    from harness.training.kinds.voxel_trainer import VoxelTrainer

    return VoxelTrainer(*given, backend)


def drjit_backend(device: torch.device) -> Literal["llvm", "cuda"]:
    """Return Dr.Jit's backend for `device`, tested in a process of its own, as it may abort; raises `NotAvailable`."""
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
