"""Bins whose colour is given at both ends: the share of a bin's light that comes from each end.

    first + second = 1 − e^−τ

`even_shares` gives half to each. With `shares_linear_in_depth` colour is linear in optical depth from end to end,

    second(τ) = ∫₀^τ e^−s s/τ ds = (1 − e^−τ (1 + τ)) / τ,

which is the rule for stiff rays: a ray sees the colour at the front of an opaque bin. A rule with one colour per bin
returns that of the middle, an error of half a bin however accurate its densities are ("order reduction" of exponential
integrators); the exponential rule of order two, ETD-2, does not.
"""

from collections.abc import Callable
from math import factorial
from typing import Any

import torch
from torch import Tensor

from baselines.numerics.sampling import Bins

Shares = Callable[[Tensor], tuple[Tensor, Tensor, Tensor]]
"""The map τ [rays, bins] → first, second, and e^−τ − ∂second/∂τ, every digit of them right for all τ from 0 to ∞."""

SERIES = [(-1) ** m * (m + 1) / factorial(m + 2) for m in range(19)]
"""The coefficients of second(τ)/τ = Σ (−1)^m (m + 1)/(m + 2)! τ^m; the next term is below 1e-17 at τ = 1."""


def even_shares(tau: Bins) -> tuple[Bins, Bins, Bins]:
    """Return the `Shares` of the mean of both colours."""
    half = -0.5 * torch.expm1(-tau)
    return half, half, 0.5 * torch.exp(-tau)


def shares_linear_in_depth(tau: Bins) -> tuple[Bins, Bins, Bins]:
    """Return the `Shares` of a colour linear in τ; the third is second(τ)/τ."""
    thin = tau < 1.0
    small = torch.where(thin, tau, 1.0)
    series = torch.full_like(tau, SERIES[-1])
    for coefficient in reversed(SERIES[:-1]):
        series = series.mul_(small).add_(coefficient)
    opacity = -torch.expm1(-tau)
    finite = tau.clamp(max=200.0)  # τ e^−τ is 0 beyond, and ∞ · 0 at ∞
    second = torch.where(thin, tau * series, (opacity - finite * torch.exp(-finite)) / tau)
    return opacity - second, second, torch.where(thin, series, second / tau)


class EndWeights(torch.autograd.Function):
    """The map τ of each bin → weights of the bins + 1 fenceposts, and T_end, with the closed-form gradient

        ∂L/∂τ_k = −T_k (e^−τ_k − s'_k) d_k − Σ_{i>k} T_i (e^−τ_i + s_i) d_i − T_end (g_end − g_bins)

    where d_i = g_{i+1} − g_i and s = second. It follows from the weights by summation by parts: terms that nearly
    cancel appear only in the differences of g, which are those of neighbouring colours.
    """

    @staticmethod
    def forward(ctx: Any, tau: Tensor, shares: Shares) -> tuple[Tensor, Tensor]:
        through = torch.cumsum(tau, dim=-1)
        T = torch.exp(-torch.cat([torch.zeros_like(through[:, :1]), through[:, :-1]], dim=-1))
        first, second, fall = shares(tau)
        T_after = torch.exp(-through)
        back = T * second
        ctx.save_for_backward(T * fall, T_after + back, T_after[:, -1])
        w = torch.nn.functional.pad(T * first, (0, 1)) + torch.nn.functional.pad(back, (1, 0))
        return w, T_after[:, -1].clone()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        g_w, g_end = gradients
        own, passed, T_end = ctx.saved_tensors
        d = torch.diff(g_w, dim=-1)
        behind = torch.cat([passed[:, 1:] * d[:, 1:], (T_end * (g_end - g_w[:, -1])).unsqueeze(-1)], dim=-1)
        return -own * d - behind.flip(-1).cumsum(-1).flip(-1), None
