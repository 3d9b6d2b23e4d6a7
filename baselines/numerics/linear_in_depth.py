"""A bin whose colour is linear in optical depth, between the colours at its two ends: the rule for stiff rays.

Where a bin is opaque, what is seen is the colour at its front. A rule that takes one colour a bin returns that of its
middle, an error of half a bin however accurate its densities are ("order reduction" of exponential integrators); the
exponential rule of order two, ETD-2, does not.

With E = e^−τ the ends of a bin get, seen from its front,

    second(τ) = ∫₀^τ e^−s s/τ ds = (1 − E (1 + τ)) / τ,   first(τ) = 1 − E − second(τ).
"""

from math import factorial
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

SERIES = [(-1) ** m * (m + 1) / factorial(m + 2) for m in range(19)]
"""second(τ)/τ = Σ (−1)^m (m + 1)/(m + 2)! τ^m; the next term is below 1e-17 at τ = 1."""


def bin_shares(
    tau: Float[Tensor, "rays bins"],
) -> tuple[Float[Tensor, "rays bins"], Float[Tensor, "rays bins"], Float[Tensor, "rays bins"]]:
    """first(τ), second(τ) and second(τ)/τ, which is also the derivative of first; every digit at all τ from 0 to ∞."""
    thin = tau < 1.0
    small = torch.where(thin, tau, 1.0)
    series = torch.full_like(tau, SERIES[-1])
    for coefficient in reversed(SERIES[:-1]):
        series = series.mul_(small).add_(coefficient)
    opacity = -torch.expm1(-tau)
    finite = tau.clamp(max=200.0)  # τ e^−τ is 0 beyond, and ∞ · 0 at ∞
    second = torch.where(thin, tau * series, (opacity - finite * torch.exp(-finite)) / tau)
    slope = torch.where(thin, series, second / tau)
    return opacity - second, second, slope


class EndWeights(torch.autograd.Function):
    """τ of each bin → weights of the bins + 1 fenceposts, and T_end, with the closed-form gradient

        ∂L/∂τ_k = −T_k s_k/τ_k · d_k − Σ_{i>k} T_i (e^−τ_i + s_i) d_i − T_end (g_end − g_N)

    where d_i = g_{i+1} − g_i and s = second. It follows from the weights by summation by parts: terms that nearly
    cancel appear nowhere but in the differences of the g, which are those of neighbouring colours.
    """

    @staticmethod
    def forward(ctx: Any, tau: Tensor) -> tuple[Tensor, Tensor]:
        through = torch.cumsum(tau, dim=-1)
        T = torch.exp(-torch.cat([torch.zeros_like(through[:, :1]), through[:, :-1]], dim=-1))
        first, second, slope = bin_shares(tau)
        T_after = torch.exp(-through)
        front, back = T * first, T * second
        ctx.save_for_backward(T * slope, T_after + back, T_after[:, -1])
        w = torch.nn.functional.pad(front, (0, 1)) + torch.nn.functional.pad(back, (1, 0))
        return w, T_after[:, -1].clone()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        g_w, g_end = gradients
        own, passed, T_end = ctx.saved_tensors
        d = torch.diff(g_w, dim=-1)
        behind = torch.cat([passed[:, 1:] * d[:, 1:], (T_end * (g_end - g_w[:, -1])).unsqueeze(-1)], dim=-1)
        return -own * d - behind.flip(-1).cumsum(-1).flip(-1)
