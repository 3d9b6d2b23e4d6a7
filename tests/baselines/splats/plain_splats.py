"""Splatting as slow and obvious as it can be: every Gaussian on every ray, from torch's operations, after Kerbl et al.
2023.
"""

import math

import torch
from scipy.special import sph_harm_y
from torch import Tensor

from baselines.splats.rasteriser import FAINTEST, LET_THROUGH, MOST_OPAQUE, SLANT


def harmonics(d: Tensor, terms: int) -> Tensor:
    """Return the first `terms` real spherical harmonics above degree 0 of a unit direction [3], from the complex ones
    without the phase (−1)^m.
    """
    polar, azimuth = math.acos(float(d[2])), math.atan2(float(d[1]), float(d[0]))
    values = []
    for degree in range(1, math.isqrt(terms + 1)):
        for order in range(-degree, degree + 1):
            both = complex(sph_harm_y(degree, abs(order), polar, azimuth)) * (-1.0) ** order
            part = both.imag if order < 0 else both.real
            values.append(part if order == 0 else math.sqrt(2.0) * part)
    return d.new_tensor(values)


def rotation(quaternion: Tensor) -> Tensor:
    w, x, y, z = quaternion / quaternion.norm()
    turn = torch.stack([torch.zeros_like(w), -z, y, z, torch.zeros_like(w), -x, -y, x, torch.zeros_like(w)])
    cross = turn.reshape(3, 3)
    return torch.eye(3, dtype=quaternion.dtype) + 2.0 * w * cross + 2.0 * cross @ cross


def drawn(
    values: Tensor, origin: Tensor, axes: Tensor, widened: float, at: Tensor, blurred: float = 0.0
) -> tuple[Tensor, Tensor]:
    """Return colour and depth [rays, 4] and transmittance [rays] at points [rays, 2] of the plane at distance 1."""
    out, through = values.new_zeros(len(at), 4), values.new_ones(len(at))
    for v in values[torch.argsort((values[:, :3].detach() - origin) @ axes[:, 2])]:
        away = v[:3] - origin
        x, y, z = away @ axes
        covariance = rotation(v[6:10]) @ torch.diag(torch.exp(2.0 * v[3:6])) @ rotation(v[6:10]).T
        covariance = axes.T @ (covariance + widened**2 * torch.eye(3, dtype=values.dtype)) @ axes
        a, b = ((along / z).clamp(-float(SLANT), float(SLANT)) for along in (x, y))
        slope = torch.stack([torch.stack([1 / z, 0 * z, -a / z]), torch.stack([0 * z, 1 / z, -b / z])])
        inverse = torch.linalg.inv(slope @ covariance @ slope.T + blurred * torch.eye(2, dtype=values.dtype))
        off = at - torch.stack([x / z, y / z])
        alpha = torch.sigmoid(v[10]) * torch.exp(-0.5 * torch.einsum("ri,ij,rj->r", off, inverse, off))
        alpha = torch.where((alpha < FAINTEST) | (through < LET_THROUGH), 0.0, alpha.clamp(max=MOST_OPAQUE))
        colour = 0.5 + 0.5 / math.sqrt(math.pi) * v[11:14]
        if len(v) > 14:
            colour = colour + v[14:].reshape(3, -1) @ harmonics((away / away.norm()).detach(), len(v[14:]) // 3)
        seen = torch.cat([colour.clamp(min=0.0), away.norm()[None]])
        out = out + (alpha * through)[:, None] * seen
        through = through * (1.0 - alpha)
    return out, through
