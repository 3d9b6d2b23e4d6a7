"""A radiance field of Gaussian blobs: as little as the contract asks for."""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import softplus

from baselines.contract import FieldSpec, uniform_weights


@dataclass(frozen=True)
class BlobSettings:
    """All that changes its results. Records hold every value, and a run with other values reuses no cell."""

    count: int = 64
    peak: float = 20.0
    """The density of a fresh blob's centre is about log 2 of it, per half of the longest side of the scene's box."""
    radius: float = 0.25
    """The radius of a fresh blob, where the longest half-extent of the scene's box is 1."""


class Blobs(nn.Module):
    """Density is a sum of blobs, colour the mean of theirs, weighted by density; the same from all sides."""

    pointwise = True
    density_limit = float("inf")

    def __init__(self, asked: FieldSpec) -> None:
        super().__init__()
        self.box, self.own = asked.box, asked.own

        def first(name: str, *shape: int) -> nn.Parameter:
            # from seed and name alone: the same in every process, whatever else was made before
            return nn.Parameter(uniform_weights(shape, 1.0, asked.seed, name))

        count = self.own.count
        self.centre = first("centre", count, 3)
        self.log_radius = first("log_radius", count)
        self.strength = first("strength", count)
        self.colour = first("colour", count, 3)

    def encode_directions(self, d: Tensor) -> Tensor:
        return d[:, :0]

    def density(self, x: Tensor) -> Tensor:
        return self._shares(x).sum(dim=-1)

    def density_before_and_after(self, x: Tensor) -> tuple[Tensor, Tensor]:
        sigma = self.density(x)
        return sigma, sigma

    def density_and_colour(self, x: Tensor, view: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
        shares = self._shares(x)
        sigma = shares.sum(dim=-1)
        # the small number keeps 0/0 away where no blob is near
        return sigma, (shares @ torch.sigmoid(self.colour)) / (sigma.unsqueeze(-1) + 1e-6)

    def parameter_counts(self) -> dict[str, int]:
        counts = {name: weight.numel() for name, weight in self.named_parameters()}
        return {**counts, "total": sum(counts.values())}

    def _shares(self, x: Tensor) -> Tensor:
        """Density of each blob at each point [points, count]."""
        p = self.box.normalised(x)
        squared = (p * p).sum(-1, keepdim=True) - 2.0 * p @ self.centre.T + (self.centre**2).sum(-1)
        radius = self.own.radius * torch.exp(self.log_radius.clamp(-3.0, 3.0))
        peak = self.own.peak / self.box.half_extent
        return peak * softplus(self.strength) * torch.exp(-0.5 * squared.clamp(min=0.0) / radius**2)
