"""A training step of NeRF in plain torch: eager, every sample evaluated, autograd through everything.

It is the oracle of faster code and the reference of `nox -s speed`. It is kept simple and slow: it builds
concatenations, encodes directions for every sample, and has no box, no grid and no chunks.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn

from baselines.composition import skip_layer
from baselines.contract import Box, NetworkSize, Rays, uniform_weights
from baselines.methods.nerf import NERF


def positional_encoding(x: Float[Tensor, "*batch axes"], bands: int) -> Float[Tensor, "*batch features"]:
    """Return [x, sin(2^0 π x), cos(2^0 π x), …, sin(2^(L−1) π x), cos(2^(L−1) π x)]."""
    features = [x]
    for k in range(bands):
        features += [torch.sin(2.0**k * math.pi * x), torch.cos(2.0**k * math.pi * x)]
    return torch.cat(features, dim=-1)


class PlainField(nn.Module):
    """The method `nerf`; its parameters have the names, shapes and first values of those of `NetworkField`."""

    def __init__(self, size: NetworkSize, box: Box, seed: int | str, view_dependent: bool = True) -> None:
        super().__init__()
        self.box = box
        self.bands = (size.position_bands, size.direction_bands)
        self.skip = skip_layer("half", size.depth)
        self.view_dependent = view_dependent
        position = 3 * (1 + 2 * size.position_bands)
        direction = 3 * (1 + 2 * size.direction_bands) if view_dependent else 0
        inputs = [position] + [size.width + position * (i == self.skip) for i in range(size.depth)]
        colour = [inputs[-1] + direction] + [size.colour_width] * size.colour_layers
        self.density_net = nn.ModuleList(nn.Linear(width, size.width) for width in inputs[:-1])
        self.density_head = nn.Linear(inputs[-1], 1)
        self.colour_net = nn.ModuleList(nn.Linear(a, b) for a, b in zip(colour, [*colour[1:], 3], strict=True))
        with torch.no_grad():
            for name, weight in self.named_parameters():
                bound = (6.0 / sum(weight.shape)) ** 0.5 if weight.ndim == 2 else 0.0
                weight.copy_(bound * uniform_weights(tuple(weight.shape), 1.0, seed, name))

    def forward(
        self, x: Float[Tensor, "rays samples 3"], d: Float[Tensor, "rays 3"]
    ) -> tuple[Float[Tensor, "rays samples"], Float[Tensor, "rays samples 3"]]:
        """Return density in 1 / scene unit, and display colour."""
        position = positional_encoding(self.box.normalised(x), self.bands[0])
        h = position
        for index, layer in enumerate(self.density_net):
            h = torch.relu(layer(h))
            if index == self.skip:
                h = torch.cat([h, position], dim=-1)
        start = NERF.start_in_units
        shift = 0.0 if start is None else math.log(math.expm1(start))
        unit = NERF.density_scale / self.box.half_extent
        sigma = unit * nn.functional.softplus(self.density_head(h).squeeze(-1) + shift)
        if self.view_dependent:
            view = positional_encoding(d, self.bands[1]).unsqueeze(1).expand(-1, x.shape[1], -1)
            h = torch.cat([h, view], dim=-1)
        for index, layer in enumerate(self.colour_net):
            h = layer(h) if index == len(self.colour_net) - 1 else torch.relu(layer(h))
        return sigma, torch.sigmoid(h)


def plain_render(
    field: PlainField, rays: Rays, samples: int, background: Float[Tensor, " 3"], generator: torch.Generator | None
) -> Float[Tensor, "rays 3"]:
    """Return the colours of `rays` (Eq. 6) with one sample per equal bin: random with a generator, else its middle."""
    o, d = rays.origins, rays.directions
    edges = torch.linspace(rays.near, rays.far, samples + 1, dtype=o.dtype, device=o.device)
    share = torch.full((len(rays), samples), 0.5)
    if generator is not None:
        share = torch.rand(len(rays), samples, generator=generator)
    t = edges[:-1] + share.to(o) * torch.diff(edges)
    sigma, colour = field(o.unsqueeze(1) + t.unsqueeze(-1) * d.unsqueeze(1), d)
    tau = sigma * torch.diff(edges)
    through = torch.exp(-torch.cumsum(tau, dim=-1))
    before = torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=-1)
    w = before * (1.0 - torch.exp(-tau))
    shown: Tensor = (w.unsqueeze(-1) * colour).sum(dim=1) + through[:, -1:] * background
    return shown


def plain_loss(
    field: PlainField, rays: Rays, colours: Float[Tensor, "rays 3"], samples: int, generator: torch.Generator | None
) -> Float[Tensor, ""]:
    return torch.mean((plain_render(field, rays, samples, torch.ones_like(colours[0]), generator) - colours) ** 2)


def plain_step(
    field: PlainField,
    optimiser: torch.optim.Optimizer,
    rays: Rays,
    colours: Float[Tensor, "rays 3"],
    samples: int,
    generator: torch.Generator | None,
) -> float:
    """Take one step on one batch; returns the loss before it."""
    optimiser.zero_grad()
    loss = plain_loss(field, rays, colours, samples, generator)
    loss.backward()
    optimiser.step()
    return loss.item()
