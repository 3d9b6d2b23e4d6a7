"""The usual quadrature of a ray: densities and lengths of bins → weights and the remaining transmittance."""

import torch
from torch import Tensor


def running_product(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Compute α = 1 − exp(−σδ) and transmittance as a running product of 1 − α + 1e-10, in any precision."""
    alpha = 1.0 - torch.exp(-sigma * lengths)
    through = torch.cumprod(torch.cat([torch.ones_like(alpha[:, :1]), 1.0 - alpha + 1e-10], dim=-1), dim=-1)
    return alpha * through[:, :-1], through[:, -1]


def depths(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return τ of each bin, the sum of τ in front of it, and T_end."""
    tau = sigma * lengths
    through = torch.cumsum(tau, dim=-1)
    before = torch.cat([torch.zeros_like(through[:, :1]), through[:, :-1]], dim=-1)
    return tau, before, torch.exp(-through[:, -1])


def stock_expm1(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Run this harness's forward pass by autograd, whose gradient of torch.expm1 is grad · (result + 1)."""
    tau, before, T_end = depths(sigma, lengths)
    return torch.exp(-before) * -torch.expm1(-tau), T_end
