"""A mean that belongs to the field and not to a call."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

MEAN_SHARE = 0.1
"""By which a held mean moves a step: the momentum of batch normalisation (Ioffe & Szegedy 2015) as torch has it."""


class RunningMean(nn.Module):
    """Detached, kept in the checkpoint, moved by training steps alone: a constant within a step and outside of one."""

    value: Tensor
    steps: Tensor
    """That have moved it."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("value", torch.zeros(()))
        self.register_buffer("steps", torch.zeros(()))
        self._seen: tuple[Tensor, int] | None = None

    def begin(self) -> None:
        """From here on `take` counts."""
        self._seen = (torch.zeros((), dtype=torch.float64, device=self.value.device), 0)

    def take(self, values: Float[Tensor, " points"]) -> None:
        """Summed in double precision: it does not matter in how many calls the values of a step come."""
        if self._seen is not None:
            total, count = self._seen
            self._seen = (total + values.detach().sum(dtype=torch.float64), count + values.numel())

    @torch.no_grad()
    def move(self, share: float = MEAN_SHARE) -> None:
        """Ends the step: to the mean of what it has seen at first, later a `share` of the way there."""
        if self._seen is not None and self._seen[1]:
            of_the_way = torch.clamp(1.0 / (self.steps + 1.0), min=share)
            self.value.lerp_((self._seen[0] / self._seen[1]).to(self.value.dtype), of_the_way)
            self.steps += 1.0
        self._seen = None

    @torch.no_grad()
    def set(self, value: Float[Tensor, ""]) -> None:
        """Ends the step with a mean that was measured otherwise."""
        self.value.copy_(value)
        self.steps += 1.0
        self._seen = None

    def drop(self) -> None:
        """Ends the step as if it had not been."""
        self._seen = None
