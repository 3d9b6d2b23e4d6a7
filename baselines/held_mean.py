"""A running mean that belongs to the field and not to a chunk."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

MEAN_SHARE = 0.1
"""The share by which a running mean moves per step: torch's momentum of batch normalisation (Ioffe & Szegedy 2015)."""


class RunningMean(nn.Module):
    """A detached mean, kept in checkpoints. Only training steps update it, each at its end."""

    value: Tensor
    steps: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("value", torch.zeros(()))
        self.register_buffer("steps", torch.zeros(()))
        self._seen: tuple[Tensor, int] | None = None

    def begin(self) -> None:
        self._seen = (torch.zeros((), dtype=torch.float64, device=self.value.device), 0)

    def observe(self, values: Float[Tensor, " points"]) -> None:
        """Add values in double precision, so that the result does not depend on how a step is split into chunks."""
        if self._seen is not None:
            total, count = self._seen
            self._seen = (total + values.detach().sum(dtype=torch.float64), count + values.numel())

    @torch.no_grad()
    def update(self, share: float = MEAN_SHARE) -> None:
        """End the step: move to the mean of the observed values at first, later by a share that falls to `share`."""
        if self._seen is not None and self._seen[1]:
            moved = torch.clamp(1.0 / (self.steps + 1.0), min=share)
            self.value.lerp_((self._seen[0] / self._seen[1]).to(self.value.dtype), moved)
            self.steps += 1.0
        self._seen = None

    def drop(self) -> None:
        self._seen = None
