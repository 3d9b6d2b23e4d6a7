"""Splatting as slow and obvious as it can be: every Gaussian on every ray, from torch's operations, after Kerbl et al.
2023.
"""

import math

import torch
from torch import Tensor

from baselines.splats.rasteriser import FAINTEST, LET_THROUGH, MOST_OPAQUE


def harmonics(d: Tensor) -> Tensor:
    """Return the real spherical harmonics of degree 1 and 2 of unit directions [points, 3]."""
    x, y, z = d.unbind(dim=-1)
    first, second = math.sqrt(0.75 / math.pi), 0.5 * math.sqrt(15.0 / math.pi)
    third = 0.25 * math.sqrt(5.0 / math.pi) * (3.0 * z * z - 1.0)
    square = 0.5 * second * (x * x - y * y)
    terms = [first * y, first * z, first * x, second * x * y, second * y * z, third, second * x * z, square]
    return torch.stack(terms, dim=-1)


def rotation(quaternion: Tensor) -> Tensor:
    w, x, y, z = quaternion / quaternion.norm()
    turn = torch.stack([torch.zeros_like(w), -z, y, z, torch.zeros_like(w), -x, -y, x, torch.zeros_like(w)])
    cross = turn.reshape(3, 3)
    return torch.eye(3, dtype=quaternion.dtype) + 2.0 * w * cross + 2.0 * cross @ cross


def drawn(values: Tensor, origin: Tensor, axes: Tensor, widened: float, at: Tensor) -> tuple[Tensor, Tensor]:
    """Return colour and depth [rays, 4] and transmittance [rays] at points [rays, 2] of the plane at distance 1."""
    out, through = values.new_zeros(len(at), 4), values.new_ones(len(at))
    for v in values[torch.argsort((values[:, :3].detach() - origin) @ axes[:, 2])]:
        away = v[:3] - origin
        x, y, z = away @ axes
        covariance = rotation(v[6:10]) @ torch.diag(torch.exp(2.0 * v[3:6])) @ rotation(v[6:10]).T
        covariance = axes.T @ (covariance + widened**2 * torch.eye(3, dtype=values.dtype)) @ axes
        slope = torch.stack([torch.stack([1 / z, 0 * z, -x / z**2]), torch.stack([0 * z, 1 / z, -y / z**2])])
        inverse = torch.linalg.inv(slope @ covariance @ slope.T)
        off = at - torch.stack([x / z, y / z])
        alpha = torch.sigmoid(v[10]) * torch.exp(-0.5 * torch.einsum("ri,ij,rj->r", off, inverse, off))
        alpha = torch.where((alpha < FAINTEST) | (through < LET_THROUGH), 0.0, alpha.clamp(max=MOST_OPAQUE))
        colour = 0.5 + 0.5 / math.sqrt(math.pi) * v[11:14]
        if len(v) > 14:
            colour = colour + v[14:].reshape(3, 8) @ harmonics((away / away.norm()).detach()[None])[0]
        seen = torch.cat([colour.clamp(min=0.0), away.norm()[None]])
        out = out + (alpha * through)[:, None] * seen
        through = through * (1.0 - alpha)
    return out, through
