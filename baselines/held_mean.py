"""A running mean that belongs to the field and not to a chunk."""

import torch
from jaxtyping import Bool, Float
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
        self._seen: Float[Tensor, " 2"] | None = None
        """The sum and the number of the values of a step, in double precision; None outside a step."""

    def begin(self) -> None:
        self._seen = torch.zeros(2, dtype=torch.float64, device=self.value.device)

    def observe(self, values: Float[Tensor, " points"], counted: Bool[Tensor, " points"] | None = None) -> None:
        """Add values, or those `counted`, in double precision: how a step is split into chunks does not matter."""
        if self._seen is None:
            return
        values = values.detach()
        if counted is None:
            total = values.sum(dtype=torch.float64)
            self._seen = self._seen + torch.stack([total, torch.full_like(total, values.numel())])
        else:
            kept = torch.where(counted, values, 0.0)
            self._seen = self._seen + torch.stack([kept.sum(dtype=torch.float64), counted.sum(dtype=torch.float64)])

    @torch.no_grad()
    def update(self, share: float = MEAN_SHARE) -> None:
        """End the step: move to the mean of the observed values at first, later by a share that falls to `share`."""
        if self._seen is not None:
            total, count = self._seen.unbind()
            moved = torch.clamp(1.0 / (self.steps + 1.0), min=share)
            seen = count > 0
            mean = torch.where(seen, total / count, self.value.double()).to(self.value.dtype)
            self.value.lerp_(mean, moved)
            self.steps += seen
        self._seen = None

    def drop(self) -> None:
        self._seen = None
