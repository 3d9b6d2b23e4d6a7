"""Radiance fields with known integrals, in place of a network (`baselines.contract.RadianceField`)."""

from collections.abc import Callable
from dataclasses import dataclass, field

import torch
from torch import Tensor

from baselines.contract import Box, Rays

ORANGE = (0.9, 0.5, 0.1)


@dataclass
class AnalyticField:
    """A field with density as a function of position and one colour; it counts the points that it evaluates."""

    sigma: Callable[[Tensor], Tensor]
    colour: tuple[float, float, float] = ORANGE
    points: int = field(default=0, init=False)

    pointwise = True

    def encode_directions(self, d: Tensor) -> Tensor:
        return d

    def density(self, x: Tensor) -> Tensor:
        return self.sigma(x)

    def density_before_and_after(self, x: Tensor) -> tuple[Tensor, Tensor]:
        return self.sigma(x), self.sigma(x)

    def density_and_colour(self, x: Tensor, view: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
        self.points += len(x)
        assert len(view) > int(ray.max()) if len(ray) else True
        return self.sigma(x), torch.tensor(self.colour, dtype=x.dtype).expand(len(x), 3)


def homogeneous(density: float) -> Callable[[Tensor], Tensor]:
    return lambda x: torch.full_like(x[:, 0], density)


def ball(density: float, radius: float) -> Callable[[Tensor], Tensor]:
    """Return a constant density within `radius` of the origin."""
    return lambda x: torch.where(x.norm(dim=-1) < radius, density, 0.0).to(x.dtype)


def soft_shell(density: float, radius: float, width: float) -> Callable[[Tensor], Tensor]:
    """Return a Gaussian of the distance from the sphere of `radius` around the origin."""
    return lambda x: density * torch.exp(-0.5 * ((x.norm(dim=-1) - radius) / width) ** 2)


def gaussian(density: float, width: float) -> Callable[[Tensor], Tensor]:
    return lambda x: density * torch.exp(-0.5 * (x**2).sum(-1) / width**2)


def smooth_ball(density: float, radius: float) -> Callable[[Tensor], Tensor]:
    """Return (1 − r²)³, which is zero outside of `radius` and smooth at it."""
    return lambda x: density * (1.0 - (x**2).sum(-1) / radius**2).clamp(min=0.0) ** 3


def chord(rays: Rays, radius: float) -> Tensor:
    """Return the length of each ray within a sphere around the origin that lies between near and far."""
    closest = (rays.origins * rays.directions).sum(-1)
    distance_squared = (rays.origins**2).sum(-1) - closest**2
    return 2.0 * (radius**2 - distance_squared).clamp(min=0.0).sqrt()


def cube(half: float = 1.0, dtype: torch.dtype = torch.float64) -> Box:
    return Box(torch.full((3,), -half, dtype=dtype), torch.full((3,), half, dtype=dtype))


def rays_at(target_spread: float, count: int, seed: int = 40, dtype: torch.dtype = torch.float64) -> Rays:
    """Return rays from random points at distance 4 towards random points near the origin."""
    generator = torch.Generator().manual_seed(seed)
    origins = 4.0 * torch.nn.functional.normalize(torch.randn(count, 3, generator=generator, dtype=dtype), dim=-1)
    targets = target_spread * torch.randn(count, 3, generator=generator, dtype=dtype)
    return Rays(origins, torch.nn.functional.normalize(targets - origins, dim=-1), near=2.0, far=6.0)
