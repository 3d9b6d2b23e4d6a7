"""Small fields of every method, as fresh and as after training, with rays and points to ask them for."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.amplifiers import AMPLIFIERS, Amplifier
from baselines.catalog import CATALOG
from baselines.composition import Parts
from baselines.contract import Box, NetworkSize, Rays, Rendering
from baselines.field import NetworkField
from baselines.numerics.encoding import PHI
from baselines.rendering import Sampling, render_rays
from tests.baselines.analytic import rays_at

SMALL = NetworkSize(depth=4, width=32, colour_layers=2, colour_width=16, position_bands=6, direction_bands=2)
EIGHT = replace(SMALL, depth=8)
BOX = Box(torch.tensor([-1.0, -0.8, -1.2]), torch.tensor([1.0, 1.0, 0.8]))
WHITE = torch.ones(3)
PARTS: dict[str, Parts] = {name: method.parts for name, method in CATALOG.items() if method.parts is not None}
"""Of every method that is a network."""
OF_THE_POINT = [name for name, parts in PARTS.items() if AMPLIFIERS[parts.amplifier]().pointwise]
OF_THE_CALL = [name for name in PARTS if name not in OF_THE_POINT]
"""Methods whose density depends on what else is asked for in a call: the paper's amplifiers as printed."""

every_method = pytest.mark.parametrize("method", PARTS)
every_depth = pytest.mark.parametrize("depth", [4, 5, 8])


def field_of(method: str, size: NetworkSize = SMALL, seed: int | str = 0, view_dependent: bool = True) -> NetworkField:
    return NetworkField(PARTS[method], size, BOX, "float32", seed, view_dependent)


def some_rays(count: int = 60) -> Rays:
    return rays_at(0.4, count, dtype=torch.float32)


def render(field: NetworkField, parts: Parts, some: Rays, generator: torch.Generator | None = None) -> Rendering:
    sampling = Sampling(bins=24, quadrature=parts.quadrature, clip_to_box=parts.quadrature != "listing4")
    return render_rays(field, None, some, BOX, sampling, None, WHITE, generator)


def some_points(count: int, seed: int = 60) -> tuple[Tensor, Tensor, Tensor]:
    """Positions, directions, and the direction that each position is seen from."""
    generator = torch.Generator().manual_seed(seed)
    x = BOX.from_unit(torch.rand(count, 3, generator=generator))
    d = torch.nn.functional.normalize(torch.randn(17, 3, generator=generator), dim=-1)
    return x, d, torch.randint(17, (count,), generator=generator)


def roughened(field: NetworkField, alpha: float | None = None) -> NetworkField:
    """As after training: a contrasted density, biases that are not zero, an amplifier that has moved."""
    generator = torch.Generator().manual_seed(61)
    with torch.no_grad():
        for name, weight in field.named_parameters():
            if name.endswith("bias"):
                weight.copy_(0.1 * torch.randn(weight.shape, generator=generator))
        field.density_head.weight *= 8.0
        if alpha is not None:
            set_alpha(field.amplifier, alpha)
    return field


@torch.no_grad()
def set_alpha(amplifier: Amplifier, alpha: float) -> None:
    """Moves the weight that α follows from so that α > 0 is `alpha`; an amplifier without one stays as it is."""
    if isinstance(weight := getattr(amplifier, "alpha", None), torch.nn.Parameter):
        weight.fill_(alpha)
    elif hasattr(amplifier, "rho"):
        softplus_of_rho = alpha * math.log(2.0) * PHI
        rho = softplus_of_rho + math.log(-math.expm1(-softplus_of_rho))
        amplifier.rho.fill_(rho)  # type: ignore[operator, union-attr]
