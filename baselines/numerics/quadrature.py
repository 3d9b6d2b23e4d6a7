"""Density along a ray → weights: quadrature rules for Eq. 1.

A rule puts points `t` [rays, points] into bins with fenceposts `t_edges` [rays, bins + 1]. From their densities `sigma`
[rays, points] and the lengths of the bins it computes the weights `w` [rays, points] of the points' colours and the
transmittance `T_end` [rays] behind the last bin, which is the weight of the background. Bins of length zero and bins
of density zero contribute exactly nothing; without any bin all is background.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from baselines.numerics.checks import require_density, require_rising
from baselines.numerics.end_weights import EndWeights, Shares, even_shares, shares_linear_in_depth
from baselines.numerics.sampling import Bins, Draws, Edges, jittered_edges, points_in_bins

PointsOfRays = Float[Tensor, "rays points"]


@dataclass(frozen=True)
class Orders:
    """The orders of convergence where density and colour are smooth and no bin is opaque."""

    colour: float
    opacity: float


def bin_lengths(t: PointsOfRays, t_edges: Edges) -> Bins:
    """Return the differences of the fenceposts; they do not depend on the points `t`."""
    del t
    return torch.diff(t_edges, dim=-1)


@dataclass(frozen=True)
class Rule:
    """A quadrature rule. Its parts may be used separately, without checks; calling the rule checks its input.

    Bin i has the points `stride · i` to `stride · i + stride − 1` and, in a `closed` rule, the first of the next bin.
    """

    place: Callable[[Tensor, Draws | None], tuple[Tensor, Tensor]]
    """Map (t_edges, draws) → points, and the fenceposts of their bins. A rule whose points are fenceposts moves
    them at random with draws (training); other rules return the given fenceposts.
    """
    optical_depth: Callable[[Tensor, Tensor], Tensor]
    """Map (sigma, lengths) → τ of each bin, [rays, bins]."""
    weights: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
    """Map (sigma, lengths) → w of each point, and T_end. A length of 0 excludes a bin."""
    orders: Orders
    lengths: Callable[[Tensor, Tensor], Tensor] = bin_lengths
    """Map (t, t_edges) → lengths of the bins."""
    stride: int = 1
    closed: bool = False
    of_the_paper: bool = False
    """Whether the rule is kept as the paper prints it, without checks of its input."""

    def __call__(
        self, sigma: PointsOfRays, t: PointsOfRays, t_edges: Edges
    ) -> tuple[PointsOfRays, Float[Tensor, " rays"]]:
        """Return weights and T_end. Raises `BadInterval`, `BadDensity`, and `TypeError` below float32."""
        if not self.of_the_paper:
            require_rising(t_edges)
            require_rising(t)
            require_density(sigma)
        return self.weights(sigma, self.lengths(t, t_edges))

    def bins_with(self, points: Bool[Tensor, "rays points"]) -> Bool[Tensor, "rays bins"]:
        if not self.closed:
            return points
        own: Tensor = points[:, :-1].unflatten(-1, (-1, self.stride)).any(dim=-1)
        return own | points[:, self.stride :: self.stride]

    def points_of(self, bins: Bool[Tensor, "rays bins"]) -> Bool[Tensor, "rays points"]:
        if not self.closed:
            return bins
        points = torch.nn.functional.pad(bins.repeat_interleave(self.stride, dim=-1), (0, 1))
        points[:, self.stride :: self.stride] |= bins
        return points

    def bin_weights(self, w: PointsOfRays, sigma: PointsOfRays, lengths: Bins) -> Bins:
        """Return the weight of each bin, as importance sampling needs it, where the rule gave its points `w`."""
        return _of_depth(self.optical_depth(sigma, lengths))[0] if self.closed else w


class _WeightsFromOpticalDepth(torch.autograd.Function):
    """The weights w_i = T_i (1 − exp(−τ_i)) with T_i = exp(−Σ_{j<i} τ_j), and T_end, with the closed-form gradient

        ∂L/∂τ_k = g_k T_{k+1} − Σ_{i>k} g_i w_i − g_end T_end = Σ_{i≥k} T_{i+1} (g_i − g_{i+1}),   g_bins = g_end.

    `expm1` keeps all digits where τ is tiny, the exclusive sum where there are many bins. The closed form avoids the
    gradient of `expm1`, which loses every digit from τ ≈ 15 on, and division by transmittances that are 0. Of its two
    forms the first subtracts nearly equal numbers (at τ = 10 per bin a third of the gradient is rounding in float32);
    the second, by summation by parts, subtracts only neighbouring colours.
    """

    @staticmethod
    def forward(ctx: Any, tau: Tensor) -> tuple[Tensor, Tensor]:
        through = torch.cumsum(tau, dim=-1)
        before = torch.cat([torch.zeros_like(through[:, :1]), through[:, :-1]], dim=-1)
        w = torch.exp(-before) * -torch.expm1(-tau)
        T_after = torch.exp(-through)
        ctx.save_for_backward(T_after)
        return w, T_after[:, -1].clone()

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        g_w, g_end = gradients
        (T_after,) = ctx.saved_tensors
        steps = torch.cat([g_w[:, 1:], g_end.unsqueeze(-1)], dim=-1)
        steps = torch.sub(g_w, steps, out=steps).mul_(T_after)
        return steps.flip(-1).cumsum(-1).flip(-1)


def _of_depth(tau: Tensor, shares: Shares | None = None) -> tuple[Tensor, Tensor]:
    """Return w of each bin, or with `shares` that of its ends, and T_end. Raises `TypeError` below float32: thin scenes
    would vanish (1 − exp(−τ) is 0 in bfloat16 for τ < 2e-3).
    """
    if tau.dtype in (torch.float16, torch.bfloat16):
        raise TypeError(f"the quadrature needs float32 or better, got {tau.dtype}")
    if tau.shape[-1] == 0:
        return tau.new_zeros(len(tau), int(shares is not None)), tau.new_ones(len(tau))
    w, T_end = _WeightsFromOpticalDepth.apply(tau) if shares is None else EndWeights.apply(tau, shares)
    return w, T_end


def _one_density_a_bin(sigma: Tensor, lengths: Tensor) -> Tensor:
    return sigma * lengths


def _mean_of_the_ends(sigma: Tensor, lengths: Tensor) -> Tensor:
    return 0.5 * (sigma[:, :-1] + sigma[:, 1:]) * lengths


def _simpson(sigma: Tensor, lengths: Tensor) -> Tensor:
    return (sigma[:, :-1:2] + 4.0 * sigma[:, 1::2] + sigma[:, 2::2]) / 6.0 * lengths


def _one_colour_a_bin(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    return _of_depth(_one_density_a_bin(sigma, lengths))


def _half_to_each_end(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    return _of_depth(_mean_of_the_ends(sigma, lengths), even_shares)


def _colour_linear_in_depth(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Return weights and T_end; the middles contribute only density, and their colours have no weight."""
    w, T_end = _of_depth(_simpson(sigma, lengths), shares_linear_in_depth)
    return torch.nn.functional.pad(w.unsqueeze(-1), (0, 1)).flatten(-2)[:, :-1], T_end


def _in_bins(t_edges: Tensor, draws: Draws | None) -> tuple[Tensor, Tensor]:
    return points_in_bins(t_edges, draws), t_edges


def _on_left_ends(t_edges: Tensor, draws: Draws | None) -> tuple[Tensor, Tensor]:
    moved = jittered_edges(t_edges, draws)
    return moved[:, :-1], moved


def _on_edges(t_edges: Tensor, draws: Draws | None) -> tuple[Tensor, Tensor]:
    moved = jittered_edges(t_edges, draws)
    return moved, moved


def _on_edges_and_middles(t_edges: Tensor, draws: Draws | None) -> tuple[Tensor, Tensor]:
    moved = jittered_edges(t_edges, draws)
    pairs = torch.stack([moved[:, :-1], points_in_bins(moved, None)], dim=-1)
    return torch.cat([pairs.flatten(-2), moved[:, -1:]], dim=-1), moved


def _between_points(t: Tensor, t_edges: Tensor) -> Tensor:
    del t_edges
    return torch.cat([t[:, 1:] - t[:, :-1], torch.full_like(t[:, :1], 1e10)], dim=-1)


def _as_printed(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    alpha = 1.0 - torch.exp(-sigma * lengths)
    transmittance = torch.cumprod(torch.cat([torch.ones_like(alpha[:, :1]), 1.0 - alpha + 1e-10], dim=-1), dim=-1)
    return alpha * transmittance[:, :-1], sigma.new_zeros(len(sigma))


midpoint = Rule(_in_bins, _one_density_a_bin, _one_colour_a_bin, Orders(2.0, 2.0))
"""The default: exact where density and colour are constant in each bin."""

left = Rule(_on_left_ends, _one_density_a_bin, _one_colour_a_bin, Orders(1.0, 1.0))
"""The density and colour of each bin's front end, as the usual NeRF programs have them, but over finite intervals."""

trapezoid = Rule(_on_edges, _mean_of_the_ends, _half_to_each_end, Orders(2.0, 2.0), closed=True)
"""Density linear in a bin, and the mean of the colours at its ends (as PL-NeRF, arXiv 2310.20685)."""

linear = Rule(_on_edges_and_middles, _simpson, _colour_linear_in_depth, Orders(2.0, 4.0), stride=2, closed=True)
"""The rule for stiff rays: τ of a bin by Simpson's rule, colour linear in τ between its ends. Two points per bin."""

listing4 = Rule(_in_bins, _one_density_a_bin, _as_printed, Orders(0.0, 0.0), lengths=_between_points, of_the_paper=True)
"""Listing 4 of the paper, changed only so far that it runs (2-D indices where it prints three).

Intervals are differences of sample points, the last interval is 1e10, 1e-10 is added in the product, and there is no
background: every ray with σ > 2e-9 at its last point is opaque. Its order is 0 wherever light reaches that point.
"""

QUADRATURES: dict[str, Rule] = {
    "midpoint": midpoint,
    "left": left,
    "trapezoid": trapezoid,
    "linear": linear,
    "listing4": listing4,
}
