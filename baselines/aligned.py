"""The forward pass of a `NetworkField` for whole rays, in matrix multiplications whose sides are multiples of 8.

The matrix units of a GPU need aligned rows, and few large multiplications rather than many small ones: inputs are
padded with zeros, the density head and the first colour layer are one matrix, and the direction's part of that layer is
added ray by ray. No value is cached between calls, so that a captured graph reads only weights and buffers.
"""

from typing import TYPE_CHECKING, cast

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import linear, pad

if TYPE_CHECKING:
    from baselines.field import NetworkField

SIDE = 8
"""Sides of matrices are padded to a multiple of this: 16 bytes in half precision."""


def features(x: Float[Tensor, "points axes"], omega: Float[Tensor, " bands"]) -> Float[Tensor, "points features"]:
    """Return `baselines.numerics.encoding.fourier_features` with angular frequencies `omega`, bit-identical."""
    angle = x.unsqueeze(-2) * omega.unsqueeze(-1)
    return torch.cat([x, torch.stack([torch.sin(angle), torch.cos(angle)], dim=-2).flatten(-3)], dim=-1)


def outputs_of_rays(
    field: "NetworkField", x: Float[Tensor, "rays points 3"], d: Float[Tensor, "rays 3"]
) -> tuple[Float[Tensor, "rays points"], Float[Tensor, "rays points 3"]]:
    """Return raw densities and colour logits of points on rays with directions `d`, both float32 as the weights are."""
    dtype, shape = field.dtype, x.shape[:2]
    position = _padded(features(field.coordinates(x.reshape(-1, 3)), field.position_omega)).to(dtype)
    view = features(field.direction_coordinates(d), field.direction_omega) if field.view_dependent else d[:, :0]
    hidden = position
    for index, layer in enumerate(cast("list[nn.Linear]", list(field.density_net))):
        hidden = field.activation(linear(hidden, _padded(layer.weight).to(dtype), layer.bias.to(dtype)))
        if index == field.skip:
            hidden = torch.cat([hidden, position], dim=-1)
    first, *others = cast("list[nn.Linear]", list(field.colour_net))
    seen = field.density_head.in_features
    heads = torch.cat([first.weight[:, :seen], field.density_head.weight])
    both = linear(hidden, _padded(_padded(heads), rows=True).to(dtype))
    colours = first.out_features
    of_view = linear(view.to(dtype), first.weight[:, seen:].to(dtype), first.bias.to(dtype)).to(first.weight.dtype)
    h = both[:, :colours].unflatten(0, shape) + of_view.unsqueeze(1)
    for layer in others:
        weight, bias = _padded(_padded(layer.weight), rows=True), _padded(layer.bias)
        h = linear(field.activation(h).to(dtype), weight.to(dtype), bias.to(dtype))[..., : layer.out_features]
    raw = both[:, colours].to(first.weight.dtype) + field.density_head.bias
    return raw.unflatten(0, shape), h.to(first.weight.dtype)


def _padded(matrix: Tensor, rows: bool = False) -> Tensor:
    """Return the matrix with its last axis, or its rows, padded with zeros to a multiple of `SIDE`."""
    missing = -matrix.shape[0 if rows else -1] % SIDE
    return pad(matrix, (0, 0, 0, missing) if rows else (0, missing)) if missing else matrix
