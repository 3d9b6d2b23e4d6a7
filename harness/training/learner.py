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


class Clipping:
    """Clipping to a fixed norm and to a multiple of the usual norm, of which a fixed bound may pass a hundred times.

    Its state is on the device of the weights, in double precision, so that a step need not wait for the host.
    """

    def __init__(self, norm: float, ratio: float, device: torch.device | None = None) -> None:
        self.norm, self.ratio = norm, ratio
        self._usual = torch.zeros((), dtype=torch.float64, device=device)
        self._clipped = torch.zeros((), dtype=torch.int64, device=device)

    def state(self) -> list[Tensor]:
        return [self._usual, self._clipped]

    @property
    def usual_norm(self) -> float | None:
        """Return the running mean of the norm, with spikes cut; None before the first norm that is not zero."""
        return float(self._usual) or None

    @usual_norm.setter
    def usual_norm(self, value: float | None) -> None:
        self._usual.fill_(value or 0.0)

    @property
    def clipped_steps(self) -> int:
        return int(self._clipped)

    @clipped_steps.setter
    def clipped_steps(self, count: int) -> None:
        self._clipped.fill_(count)

    @property
    def allowed(self) -> Float[Tensor, ""]:
        known = torch.clamp(self.ratio * self._usual, max=self.norm)
        return torch.where(self._usual > 0.0, known, self.norm)

    def scale(self, norm: float) -> float:
        """Return the factor in (0, 1] for a gradient of this finite norm, and include the norm in the running mean."""
        return float(self.factor(torch.full_like(self._usual, norm)))

    def factor(self, norm: Float[Tensor, ""]) -> Float[Tensor, ""]:
        """Return `scale` as a tensor on the device, for a norm on the device."""
        norm, allowed, usual = norm.to(self._usual.dtype), self.allowed, self._usual
        counted = torch.minimum(norm, SPIKE * allowed)
        moved = torch.where(usual > 0.0, usual + (counted - usual) / NORMS_REMEMBERED, counted)
        self._usual.copy_(torch.where(norm > 0.0, moved, usual))
        clipped = norm > allowed
        self._clipped.add_(clipped)
        return torch.where(clipped, allowed / norm, 1.0)


@runtime_checkable
class TakesTurns(Protocol):
    """Takes many steps of a learner between two looks of the host (`harness.training.turns`)."""

    @property
    def capacity(self) -> float:
        """Return the share of the points of a batch that a step can evaluate."""

    def take(self, batch_at: "Callable[[int], Batch]", share: float) -> None: ...
    def properties(self) -> dict[str, float | str | None]: ...
    def release(self) -> None:
        """Free the memory that turns need."""


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
        """Return the optimiser's state."""

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


def turns_of(learner: Stepped) -> TakesTurns | None:
    """Return what takes the learner's turns; None for a learner that takes one step at a time."""
    turns: TakesTurns | None = getattr(learner, "turns", None)
    return turns


def take_turn(learner: Stepped, batch_at: Callable[[int], Batch], share: float = 1.0) -> None:
    """Take the learner's next step, or its next turn of many, which ends at the `share` of its budget at the latest."""
    turns = turns_of(learner)
    if turns is None:
        take_step(learner, batch_at)
    else:
        turns.take(batch_at, share)


def steps(learner: L, batch_at: Callable[[int], Batch], until: Callable[[L], bool] | None = None) -> Iterator[L]:
    """Step the learner until `until` holds, or to the end of its budget. Yield it after every step, off its clock."""
    while not (until(learner) if until else learner.progress >= 1.0):
        take_step(learner, batch_at)
        yield learner


def train(learner: L, batch_at: Callable[[int], Batch], until: Callable[[L], bool] | None = None) -> L:
    """Train to the end of the budget, or until `until` holds, which is asked after every step."""
    advance: Callable[[Stepped, Callable[[int], Batch]], None] = take_step if until else take_turn
    while not (until(learner) if until else learner.progress >= 1.0):
        advance(learner, batch_at)
    return learner


def at_step(count: int) -> Callable[[Stepped], bool]:
    return lambda learner: learner.step >= count
