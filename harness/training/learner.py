"""The interface of a method in training; the loop that steps it; the clipping of gradients."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Box, LearnedField, Rays, Rendering
from baselines.occupancy import OccupancyGrid
from harness.machine.stopwatch import Stopwatch
from harness.plan.plugins import own_settings
from harness.plan.schedule import Budget
from harness.plan.settings import TrainSettings
from harness.training.batches import Batch

NORMS_REMEMBERED = 20
SPIKE = 10.0
"""The running mean counts a norm as at most this multiple of the allowed norm. A spike of any height makes the mean at
most (10 · 4 − 1) / 20 + 1 = 2.95 times as large; norms that last or recur raise it in a few steps. If norms counted
only as they are clipped, one batch in ten would be cut to 6 times the norm of the others permanently.
"""


@dataclass
class Clipping:
    """Clipping to a fixed norm and to a multiple of the usual norm, of which a fixed bound may pass a hundred times."""

    norm: float
    ratio: float
    usual_norm: float | None = None
    """The running mean of the norm, with spikes cut; None before the first norm that is not zero."""
    clipped_steps: int = 0

    @property
    def allowed(self) -> float:
        return self.norm if self.usual_norm is None else min(self.norm, self.ratio * self.usual_norm)

    def scale(self, norm: float) -> float:
        """Return the factor in (0, 1] for a gradient of this finite norm, and include the norm in the running mean."""
        allowed = self.allowed
        if norm > 0.0:
            counted, usual = min(norm, SPIKE * allowed), self.usual_norm
            self.usual_norm = counted if usual is None else usual + (counted - usual) / NORMS_REMEMBERED
        if norm <= allowed:
            return 1.0
        self.clipped_steps += 1
        return allowed / norm


@runtime_checkable
class Stepped(Protocol):
    """The part of a `Learner` that the training loop needs."""

    step: int
    clock: Stopwatch

    @property
    def progress(self) -> float: ...
    def train_on(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None: ...


@runtime_checkable
class Learner(Stepped, Protocol):
    """One method on one scene with one seed, trained one batch at a time; usually a `harness.training.trainer.Trainer`.
    `train_on`, `render` and `density` raise `harness.training.trainer.Diverged` for a number that is not finite.
    """

    method: str
    box: Box
    device: torch.device
    clipping: Clipping
    network_evaluations: int
    """The number of points at which the method was evaluated for training so far."""
    trace: dict[str, list[float | None]]
    grid: OccupancyGrid | None
    """The occupancy grid, if the method has one that the harness keeps."""

    @property
    def whole_views(self) -> bool:
        """Return whether a batch is all pixels of one view, rather than rays of all views."""

    @property
    def field(self) -> LearnedField: ...

    @property
    def fields(self) -> Any:
        """Return the object whose `state_dict` a checkpoint stores."""

    def warm_up(self, rays: Rays, colours: Float[Tensor, "rays 3"]) -> None: ...
    def render(self, rays: Rays, chunk: int, bins: int | None = None) -> Rendering:
        """Render in chunks of `chunk` rays, with `bins` per ray instead of those of the settings."""

    def rendered_by(self) -> dict[str, Any]:
        """Return all that a picture depends on except rays, `chunk` and the trained state, as plain data."""

    def restore(self, tensors: dict[str, Tensor], step: int) -> None:
        """Restore the tensors that `harness.training.checkpoints.tensors_of` returned after `step` steps."""

    def optimiser_tensors(self) -> dict[str, Tensor]:
        """Return the optimiser's state ."""

    def restore_optimiser(self, tensors: dict[str, Tensor]) -> None:
        """Restore the state that `optimiser_tensors` returned, after `restore`."""

    def amplifier_scalars(self) -> dict[str, float | None]: ...

    def averaged(self) -> AbstractContextManager[None]:
        """Enclose code that must see the state that would be stored if training ended here."""


@dataclass(frozen=True)
class Job:
    """The argument of a trainer (`baselines.catalog.Method.trainer`)."""

    method: str
    box: Box
    settings: TrainSettings
    budget: Budget
    seed: int | str
    device: torch.device
    view_dependent: bool = True
    """Whether colour may depend on direction; False where the scene looks the same from all sides."""

    @property
    def own(self) -> Any:
        """Return the settings of the method: those in `settings`, else those of the catalogue."""
        return own_settings(self.method, self.settings.own)


L = TypeVar("L", bound=Stepped)


def warm_up(learner: Learner, batch_at: Callable[[int], Batch]) -> None:
    """Run everything that is done only once, on the batch of the first step and off the learner's clock."""
    batch = batch_at(0)
    learner.warm_up(batch.rays, batch.colours)


def take_step(learner: Stepped, batch_at: Callable[[int], Batch]) -> None:
    """Take the learner's next step; `batch_at` returns the batch of a step (`Batches.stream`). Raises `Diverged`. The
    time of making the batch counts even if another learner caused it, as this one would have needed it too.
    """
    batch = batch_at(learner.step)
    learner.clock.add(batch.seconds, batch.core_seconds)
    learner.train_on(batch.rays, batch.colours)


def steps(learner: L, batch_at: Callable[[int], Batch], until: Callable[[L], bool] | None = None) -> Iterator[L]:
    """Step the learner until `until` holds, or to the end of its budget. Yield it after every step, off its clock."""
    while not (until(learner) if until else learner.progress >= 1.0):
        take_step(learner, batch_at)
        yield learner


def train(learner: L, batch_at: Callable[[int], Batch], until: Callable[[L], bool] | None = None) -> L:
    for _ in steps(learner, batch_at, until):
        pass
    return learner


def at_step(count: int) -> Callable[[Stepped], bool]:
    return lambda learner: learner.step >= count
