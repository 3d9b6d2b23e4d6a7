"""The method under test: its fields in a small size, and the rays and points at which they are evaluated."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from baselines.amplifiers import Amplifier
from baselines.catalog import Method
from baselines.contract import Box, FieldSpec, NetworkSize, Rays, Rendering
from baselines.field import field_of
from baselines.marching.sampling_plan import Sampling
from baselines.rendering import render_rays
from harness.plan.plugins import method_named

SMALL = NetworkSize(depth=4, width=32, colour_layers=2, colour_width=16, position_bands=6, direction_bands=2)
BOX = Box(torch.tensor([-1.0, -0.8, -1.2]), torch.tensor([1.0, 1.0, 0.8]))
WHITE = torch.ones(3)
NEAR, FAR = 2.0, 6.0


class Broken(Exception):
    """A check that does not hold; the message is the reason."""


@dataclass(frozen=True)
class Subject:
    name: str

    @cached_property
    def method(self) -> Method:
        return method_named(self.name)

    def field(self, depth: int = SMALL.depth, seed: int | str = 0, view_dependent: bool = True, box: Box = BOX) -> Any:
        size = replace(SMALL, depth=depth)
        return field_of(self.method, FieldSpec(size, box, "float32", seed, view_dependent, self.method.settings))

    def rendered(self, field: Any, rays: Rays, generator: torch.Generator | None = None) -> Rendering:
        return rendered(field, self.quadrature, rays, generator)

    @property
    def quadrature(self) -> str:
        return self.method.parts.quadrature if self.method.parts is not None else "midpoint"


def rendered(field: Any, quadrature: str, rays: Rays, generator: torch.Generator | None = None) -> Rendering:
    """Render with 24 bins per ray; given a generator, points are random inside them."""
    kind = rays.origins.dtype
    box = Box(BOX.lower.to(kind), BOX.upper.to(kind))
    # Listing 4 takes its background from the last point before `far`
    sampling = Sampling(bins=24, quadrature=quadrature, clip_to_box=quadrature != "listing4")
    return render_rays(field, None, rays, box, sampling, None, WHITE.to(kind), generator)


def some_rays(count: int = 60) -> Rays:
    """Return rays from all sides towards the box; some miss it."""
    generator = torch.Generator().manual_seed(62)
    origins = 4.0 * nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)
    aims = 1.2 * torch.randn(count, 3, generator=generator).clamp(-1.0, 1.0)
    return Rays(origins, nn.functional.normalize(aims - origins, dim=-1), NEAR, FAR)


def some_points(count: int) -> tuple[Float[Tensor, "points 3"], Float[Tensor, "17 3"], Int[Tensor, " points"]]:
    """Return positions, directions, and the index of each position's direction."""
    generator = torch.Generator().manual_seed(60)
    x = BOX.from_unit(torch.rand(count, 3, generator=generator))
    d = nn.functional.normalize(torch.randn(17, 3, generator=generator), dim=-1)
    return x, d, torch.randint(17, (count,), generator=generator)


def roughened(field: Any, alpha: float | None = None) -> Any:
    """Change the field as training would: densities of high contrast, biases other than 0, and `alpha` if given."""
    generator = torch.Generator().manual_seed(61)
    with torch.no_grad():
        for name, weight in field.named_parameters():
            if name.endswith("bias"):
                weight.copy_(0.1 * torch.randn(weight.shape, generator=generator))
        if isinstance(head := getattr(field, "density_head", None), nn.Linear):
            head.weight *= 8.0
        if alpha is not None and isinstance(amplifier := getattr(field, "amplifier", None), nn.Module):
            set_alpha(amplifier, alpha)
    return field


@torch.no_grad()
def set_alpha(amplifier: Amplifier | nn.Module, alpha: float) -> None:
    """Set the parameter of α; an amplifier without one has all its learnt scalars multiplied by 1.5."""
    if isinstance(weight := getattr(amplifier, "alpha", None), nn.Parameter):
        weight.fill_(alpha)
        return
    for scalar in amplifier.parameters():
        if scalar.ndim == 0:
            scalar.mul_(1.5)
