"""Distances along rays: fenceposts, points inside bins, and importance sampling by an inverse distribution.

`t_edges` [rays, bins + 1] are fenceposts in rising order, `t` [rays, bins] points inside the bins.
"""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

Edges = Float[Tensor, "rays edges"]
Bins = Float[Tensor, "rays bins"]


def uniform_edges(entry: Float[Tensor, " rays"], leave: Float[Tensor, " rays"], bins: int) -> Edges:
    """Return bins + 1 equally spaced fenceposts from `entry` to `leave` of each ray, both ends exact."""
    if bins < 1:
        raise ValueError(f"bins must be >= 1, is {bins}")
    share = torch.linspace(0.0, 1.0, bins + 1, dtype=entry.dtype, device=entry.device)
    return torch.lerp(entry.unsqueeze(-1), leave.unsqueeze(-1), share)


@runtime_checkable
class Drawn(Protocol):
    """Random numbers that were drawn before; who takes them does not check them on the host."""

    def uniform(self, shape: tuple[int, ...], like: Tensor) -> Tensor: ...


Draws = torch.Generator | Drawn


def uniform(shape: Sequence[int], draws: Draws, like: Tensor) -> Tensor:
    """Draw numbers in [0, 1) of the dtype and device of `like`; float32 and float64 get the same numbers."""
    if isinstance(draws, torch.Generator):
        return torch.rand(tuple(shape), generator=draws, device=draws.device).to(like)
    return draws.uniform(tuple(shape), like)


def points_in_bins(t_edges: Edges, draws: Draws | None) -> Bins:
    """Return one point in each bin: uniformly random with `draws`, the midpoint without one."""
    left, right = t_edges[:, :-1], t_edges[:, 1:]
    if draws is None:
        return 0.5 * (left + right)
    return torch.lerp(left, right, uniform(left.shape, draws, left))


def jittered_edges(t_edges: Edges, draws: Draws | None) -> Edges:
    """Move each inner fencepost at random between the middles of its bins; without `draws`, return `t_edges`."""
    if draws is None:
        return t_edges
    inner = points_in_bins(points_in_bins(t_edges, None), draws)
    return torch.cat([t_edges[:, :1], inner, t_edges[:, -1:]], dim=-1) if t_edges.shape[-1] > 1 else t_edges


def inverse_cdf_edges(t_edges: Edges, w: Bins, count: int, draws: Draws | None) -> Float[Tensor, "rays count"]:
    """Return `count` distances in rising order, distributed as the step function with mass `w` in each bin. With
    `draws` they are random in their strata, without them at the midpoints. See also `inverse_cdf`.
    """
    if draws is None:
        u = torch.full((w.shape[0], count), 0.5, dtype=w.dtype, device=w.device)
    else:
        u = uniform((w.shape[0], count), draws, w)
    strata = (torch.arange(count, dtype=w.dtype, device=w.device) + u) / count
    return inverse_cdf(t_edges, w, strata, check=draws is None or isinstance(draws, torch.Generator))


def inverse_cdf(
    t_edges: Edges, w: Bins, u: Float[Tensor, "rays count"], check: bool = True
) -> Float[Tensor, "rays count"]:
    """Return the distances below which the shares `u`, 0 to 1, of all mass lie. They stay within the ray and rise as
    `u` does.

    A ray without any weight is sampled uniformly. No gradient reaches `w` or `u`. With `check`, raises
    `FloatingPointError` where a weight is not finite, which would spread silently, and `ValueError` where it is
    negative; both name ray and bin. Without it the host reads nothing, and a NaN gives NaN.
    """
    w, u = w.detach(), u.detach()
    if check:
        _require_weights(w)
    total = w.sum(dim=-1, keepdim=True)
    # the weights may be finite and their sum not
    w = w / torch.where(torch.isfinite(total), 1.0, w.amax(dim=-1, keepdim=True).clamp(min=1.0))
    total = w.sum(dim=-1, keepdim=True)
    share = torch.where(total > 0, w / total.clamp(min=torch.finfo(w.dtype).tiny), 1.0 / w.shape[-1])
    cdf = torch.cumsum(share, dim=-1)
    cdf = torch.cat([torch.zeros_like(total), cdf / cdf[:, -1:]], dim=-1)
    # below 1, as the last stratum can round to 1, which belongs to the last bin even if that has no weight
    u = u.clamp(min=0.0, max=1.0 - 0.5 * torch.finfo(w.dtype).eps)
    right = torch.searchsorted(cdf, u, right=True).clamp(1, w.shape[-1])
    cdf_left, cdf_right = cdf.gather(-1, right - 1), cdf.gather(-1, right)
    t_left, t_right = t_edges.gather(-1, right - 1), t_edges.gather(-1, right)
    mass = cdf_right - cdf_left
    inside = torch.where(mass > 0, (u - cdf_left) / mass.clamp(min=torch.finfo(w.dtype).tiny), 0.5)
    return torch.lerp(t_left, t_right, inside.clamp(0.0, 1.0))


def _require_weights(w: Tensor) -> None:
    if w.numel() == 0:
        return
    least, most = torch.aminmax(w)  # either is NaN if any weight is
    if bool((least >= 0) & (most < torch.inf)):
        return
    finite = torch.isfinite(w)
    ray, bin_ = (int(index) for index in torch.nonzero(~finite if not bool(finite.all()) else w < 0)[0])
    where = f"weight {float(w[ray, bin_])} of bin {bin_} on ray {ray}"
    if not bool(finite.all()):
        raise FloatingPointError(f"{where}: weights of the inverse distribution must be finite")
    raise ValueError(f"{where}: weights of the inverse distribution must be >= 0")
