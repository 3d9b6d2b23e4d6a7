"""What the harness asks of a method in training, whatever it is made of, and who makes the right one."""

import importlib.util
import os
from typing import Any, Literal, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Box, Rays, Rendering
from baselines.occupancy import OccupancyGrid
from harness.clipping import Clipping
from harness.plugins import method_named
from harness.schedule import Budget
from harness.settings import TrainSettings
from harness.stopwatch import Stopwatch
from harness.trainer import Trainer
from scenes.errors import InputError
from scenes.variant import OLDEST_LLVM, llvm_libraries, probe


class NotAvailable(InputError):
    """A method that this machine cannot train. The message says what is missing.

    In a comparison its cells end as `not_available`; a command that is about this method alone ends with the message.
    """


@runtime_checkable
class LearnedField(Protocol):
    """The density that scoring looks at, and what it is made of."""

    @property
    def density_limit(self) -> float:
        """The density that no point exceeds, in 1 / scene unit; infinite where there is no such limit."""
        ...

    @property
    def pointwise(self) -> bool:
        """Whether a point's density does not depend on the other points of the call."""
        ...

    def density(self, x: Float[Tensor, "points 3"]) -> Float[Tensor, " points"]: ...

    def density_before_and_after(
        self, x: Float[Tensor, "points 3"]
    ) -> tuple[Float[Tensor, " points"], Float[Tensor, " points"]]:
        """The density entering the amplifier and the density that is rendered; equal without an amplifier."""
        ...

    def parameter_counts(self) -> dict[str, int]:
        """Numbers that are learnt, by component, and their `total`."""
        ...


@runtime_checkable
class Stored(Protocol):
    """What a checkpoint keeps."""

    def state_dict(self) -> dict[str, Any]: ...


@runtime_checkable
class Learner(Protocol):
    """One method on one scene with one seed, trained a batch at a time; `harness.trainer.Trainer` is the usual one.

    `train_on`, `render` and `density` raise `harness.trainer.Diverged` rather than go on with a number that is not
    finite.
    """

    method: str
    box: Box
    device: torch.device
    clock: Stopwatch
    clipping: Clipping
    step: int
    network_evaluations: int
    """Points at which the method was evaluated for training so far."""
    trace: dict[str, list[float | None]]
    grid: OccupancyGrid | None
    """What leaves empty space out, where the method has one that the harness keeps."""

    @property
    def field(self) -> LearnedField: ...

    @property
    def fields(self) -> Stored: ...

    @property
    def progress(self) -> float: ...

    def warm_up(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None: ...

    def train_on(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None: ...

    def render(self, rays: Rays, chunk: int, bins: int | None = None) -> Rendering:
        """`chunk` rays a call; `bins` a ray instead of those of the settings."""
        ...

    def rendered_by(self) -> dict[str, Any]:
        """All that a picture depends on besides rays, `chunk` and what training changed, as plain data."""
        ...

    def restore(self, tensors: dict[str, Tensor], step: int) -> None:
        """What `harness.checkpoints.tensors_of` gave after `step` steps, put back."""
        ...

    def optimiser_tensors(self) -> dict[str, Tensor]:
        """What the optimiser remembers of the steps so far; names without an order."""
        ...

    def restore_optimiser(self, tensors: dict[str, Tensor]) -> None:
        """What `optimiser_tensors` gave, put back after `restore`."""
        ...

    def amplifier_scalars(self) -> dict[str, float | None]: ...


def learner_for(
    method: str,
    box: Box,
    settings: TrainSettings,
    budget: Budget,
    seed: int | str,
    device: torch.device,
    view_dependent: bool = True,
) -> Learner:
    """The method ready to be trained. Raises `NotAvailable` where this machine lacks what it needs, and `InputError`
    where a user's own package that offers it cannot be loaded.
    """
    if method_named(method).kind == "network":
        return Trainer(method, box, settings, budget, seed, device, view_dependent)
    backend = drjit_backend(device)
    from harness.voxel_trainer import VoxelTrainer

    return VoxelTrainer(method, box, settings, budget, seed, device, view_dependent, backend)


def drjit_backend(device: torch.device) -> Literal["llvm", "cuda"]:
    """Dr.Jit's backend for `device`, found to work in a process of its own, as it may abort; raises `NotAvailable`."""
    if importlib.util.find_spec("drjit") is None:
        raise NotAvailable("needs the package drjit, which is not installed")
    if device.type == "cuda" and torch.version.hip:
        raise NotAvailable("Dr.Jit has no backend for ROCm; --device cpu trains it with LLVM")
    if device.type == "cuda":
        failure = probe("cuda_ad_rgb", "")
        if failure is not None:
            raise NotAvailable(f"Dr.Jit's CUDA backend does not work here: {failure}")
        return "cuda"
    failures = []
    for library in map(str, llvm_libraries()):
        failure = probe("llvm_ad_rgb", library)
        if failure is None:
            os.environ["DRJIT_LIBLLVM_PATH"] = library
            return "llvm"
        failures.append(f"{library} failed: {failure}")
    found = "; ".join(failures) or "none was found"
    raise NotAvailable(
        f"needs the shared library of LLVM {OLDEST_LLVM} or newer for Dr.Jit: {found}; install one (Debian: libllvm19) "
        "or name it in DRJIT_LIBLLVM_PATH"
    )
