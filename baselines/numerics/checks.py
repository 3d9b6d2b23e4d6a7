"""Checks that refuse invalid rays: intervals that run backwards or never end, and invalid densities.

Every check reads its tensor once and synchronises with the device once; only a failure looks for the invalid value.
Nothing is repaired: a NaN that is replaced silently is a wrong picture.
"""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor


class BadInterval(ValueError):
    """Distances along a ray that do not rise, or are not finite; `ray` is None if all rays share them."""

    def __init__(self, ray: int | None, what: str) -> None:
        super().__init__(f"{'every ray' if ray is None else f'ray {ray}'}: {what}")
        self.ray = ray


class BadDensity(FloatingPointError):
    """A density that is negative, infinite or NaN, at `sample` on `ray`."""

    def __init__(self, ray: int, sample: int, value: float) -> None:
        super().__init__(f"density {value} of sample {sample} on ray {ray}: must be finite and >= 0")
        self.ray = ray
        self.sample = sample
        self.value = value

    def among(self, rays: Int[Tensor, " chosen"]) -> "BadDensity":
        """Return the same error for the complete batch, where `ray` is an index into `rays`."""
        return BadDensity(int(rays[self.ray]), self.sample, self.value)


def require_interval(near: float, far: float) -> None:
    """Require near <= far, both finite; raises `BadInterval`. Length 0 is valid and shows the background."""
    if not (math.isfinite(near) and math.isfinite(far) and near <= far):
        raise BadInterval(None, f"runs from {near} to {far}; near and far must be finite, near <= far")


def require_rising(t: Float[Tensor, "rays places"]) -> None:
    """Require finite distances that do not fall along a ray; raises `BadInterval` naming the ray."""
    ends = torch.cat([t[:, :1], t[:, -1:]])
    # NaN fails both comparisons; where distances rise, the ends tell whether they are finite
    if bool((torch.diff(t, dim=-1) >= 0).all() & torch.isfinite(ends).all()):
        return
    finite = torch.isfinite(t)
    rising = torch.cat([finite[:, :1], (torch.diff(t, dim=-1) >= 0) & finite[:, 1:]], dim=-1)
    ray, place = (int(index) for index in torch.nonzero(~rising)[0])
    before = f" after {float(t[ray, place - 1])}" if place else ""
    raise BadInterval(ray, f"distance {place} is {float(t[ray, place])}{before}; must be finite and rise")


def require_density(sigma: Float[Tensor, "rays samples"]) -> None:
    """Require finite densities >= 0; raises `BadDensity` naming ray and sample."""
    if sigma.numel() == 0:
        return
    least, most = torch.aminmax(sigma.detach())  # either is NaN if any density is
    if bool((least >= 0) & (most < torch.inf)):
        return
    ray, sample = (int(index) for index in torch.nonzero(~((sigma >= 0) & (sigma < torch.inf)))[0])
    raise BadDensity(ray, sample, float(sigma.detach()[ray, sample]))
