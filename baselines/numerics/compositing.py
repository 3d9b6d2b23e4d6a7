"""Weights × values + background → colour and depth of a ray (Eq. 6)."""

import torch
from jaxtyping import Float, Int
from torch import Tensor


def composite(
    w: Float[Tensor, " points"],
    ray: Int[Tensor, " points"],
    values: Float[Tensor, "points channels"],
    T_end: Float[Tensor, " rays"],
    background: Float[Tensor, " channels"],
) -> Float[Tensor, "rays channels"]:
    """Return Σ w_i c_i + T_end · background of each ray; `ray` is the ray of each point."""
    return (T_end.unsqueeze(-1) * background).index_add(0, ray, w.unsqueeze(-1) * values)


def expected_depth(w: Float[Tensor, "rays bins"], t: Float[Tensor, "rays bins"], far: float) -> Float[Tensor, " rays"]:
    """Return the mean distance at which the ray hits geometry, Σ w t / Σ w; `far` where it hits nothing."""
    return hit_distance((w * t).sum(dim=-1), w.sum(dim=-1), far)


def hit_distance(weighted: Float[Tensor, " rays"], w: Float[Tensor, " rays"], far: float) -> Float[Tensor, " rays"]:
    """Return the mean distance of the hit from the sums Σ w t and Σ w of a ray."""
    hit = w > 0
    return torch.where(hit, weighted / torch.where(hit, w, 1.0), far)
