"""A cell in the middle of its training: how often it is kept, and how it goes on.

What is drawn at random depends on a cell's seed and step alone (`harness.seeds`), so weights, optimiser, occupancy
grid, counters and what was scored so far are all that there is to keep. On a CPU, a cell that goes on from its file
ends in the bits of one that was never interrupted; its clock goes on as well, from where it stood.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.unfinished_file import Unfinished

if TYPE_CHECKING:
    from harness.learner import Learner

LARGEST_SHARE = 0.02
"""Of its time that a group spends on keeping: what takes long is kept less often."""


class Keeping:
    """When a group's cells are kept: every so many seconds, and seldom enough to cost little; with 0 always."""

    def __init__(self, every: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._every = every
        self._clock = clock
        self._due = clock() + every

    @property
    def is_due(self) -> bool:
        return self._clock() >= self._due

    @contextmanager
    def done(self) -> Iterator[None]:
        """Around the writing."""
        began = self._clock()
        yield
        ended = self._clock()
        self._due = ended + (max(self._every, (ended - began) / LARGEST_SHARE) if self._every else 0.0)


def training_state(learner: "Learner") -> Unfinished:
    """All that training has changed in a learner."""
    from harness.checkpoints import tensors_of

    tensors = {f"trained.{name}": one for name, one in tensors_of(learner).items()}
    tensors |= {f"optimiser.{name}": one for name, one in learner.optimiser_tensors().items()}
    listing: dict[str, Any] = {
        "step": learner.step,
        "seconds": learner.clock.seconds,
        "network_evaluations": learner.network_evaluations,
        "usual_norm": learner.clipping.usual_norm,
        "clipped_steps": learner.clipping.clipped_steps,
        "trace": learner.trace,
    }
    if learner.grid is not None:
        tensors["grid.density"] = learner.grid.density
        listing["grid_emptied"] = learner.grid.emptied
    return Unfinished(listing, {name: np.array(one.detach().cpu().numpy()) for name, one in tensors.items()})


def restore_training(learner: "Learner", kept: Unfinished) -> None:
    """Makes a fresh learner of the same settings what it was. Where it was another one, raises anything, and leaves the
    learner good for nothing."""
    import torch

    def tensors(prefix: str) -> dict[str, torch.Tensor]:
        return {name: torch.tensor(one, device=learner.device) for name, one in kept.under(prefix).items()}

    listing = kept.listing
    learner.restore(tensors("trained"), listing["step"])
    learner.restore_optimiser(tensors("optimiser"))
    if learner.grid is not None:
        learner.grid.density = tensors("grid")["density"]
        learner.grid.emptied = listing["grid_emptied"]
    learner.clock.seconds = listing["seconds"]
    learner.network_evaluations = listing["network_evaluations"]
    learner.clipping.usual_norm = listing["usual_norm"]
    learner.clipping.clipped_steps = listing["clipped_steps"]
    learner.trace = {name: list(series) for name, series in listing["trace"].items()}
