"""Fourier features of positions and directions (paper Eq. 2 and Eq. 3, Listing 1).

`f` is a frequency ladder [bands], `x` coordinates [..., axes]. A ladder of base b is f_k = b^k, k = 0 … L−1;
NeRF has base 2, the paper base φ. `encode` gives the same features faster; `fourier_features` is its oracle.
"""

import math
from functools import cache

import torch
from jaxtyping import Float
from torch import Tensor

PHI = (1.0 + math.sqrt(5.0)) / 2.0

REACH = 1.0001
"""The largest coordinate for which the errors stated here hold: rays are cut to the box, which rounds by 1e-6."""


def frequency_ladder(base: float, bands: int, dtype: torch.dtype | None = None) -> Float[Tensor, " bands"]:
    """Return f_k = base^k for k = 0 … bands − 1 (Eq. 2), rounded once from double precision. Raises `ValueError` for
    fewer than 0 bands, and for more than `dtype` can hold.
    """
    if bands < 0:
        raise ValueError(f"bands must be >= 0, is {bands}")
    dtype = dtype or torch.get_default_dtype()
    if bands > 1 and (bands - 1) * math.log(base) > math.log(torch.finfo(dtype).max):
        most = 1 + int(math.log(torch.finfo(dtype).max, base))
        raise ValueError(f"{bands} bands of base {base:g} exceed {dtype}; give at most {most}")
    return torch.tensor([base**k for k in range(bands)], dtype=torch.float64).to(dtype)


def matched_bands(base: float, bands: int) -> int:
    """Return the largest number of bands of 2^k that reach no further than base^(bands − 1): the bandwidth control."""
    return 1 + math.floor((bands - 1) * math.log2(base))


def feature_count(axes: int, bands: int) -> int:
    """Return the width of `fourier_features`: the raw coordinates and a sine and a cosine for each band and axis."""
    return axes * (1 + 2 * bands)


def checked_positions(x: Float[Tensor, "points axes"]) -> Float[Tensor, "points axes"]:
    """Return `x` itself. Raises `ValueError` naming the first point with a coordinate not finite or beyond `REACH`.

    This is for callers whose points do not come from rays cut to the box (slices, meshes, probes). The error of an
    angle f π x grows in proportion to x: at x = 1e4 the top band of base 2 is noise (error 0.8), at 1e36 it is NaN.
    """
    allowed = (x.abs() <= REACH).all(dim=-1)  # a NaN compares as not allowed
    if not bool(allowed.all()):
        point = int(allowed.int().argmin())
        raise ValueError(
            f"point {point} at {x[point].tolist()} is not in the box, whose coordinates end at ±{REACH:g}; "
            "normalise positions by the box, and leave out what lies outside of it"
        )
    return x


def fourier_features(x: Float[Tensor, "*batch axes"], f: Float[Tensor, " bands"]) -> Float[Tensor, "*batch features"]:
    """Return [x, sin(f_0 π x), cos(f_0 π x), …, cos(f_{L−1} π x)] as Listing 1; no bands give x itself.

    In float32 at |x| <= 1 the absolute error is below 1.2e-4 at 2^9 and 1.2e-5 at φ^9, from rounding f π x. Reduced
    precision would lose the upper bands altogether (error 1.0 in bfloat16), so this runs in float32 or better.
    """
    if x.dtype in (torch.float16, torch.bfloat16):
        raise TypeError(f"the encoding needs float32 or better, got {x.dtype}: its upper bands would be noise")
    return features_at(x, (math.pi * f).to(x.dtype))


def features_at(x: Float[Tensor, "*batch axes"], omega: Float[Tensor, " bands"]) -> Float[Tensor, "*batch features"]:
    """Return `fourier_features` with given angular frequencies ω = f π."""
    angle = x.unsqueeze(-2) * omega.unsqueeze(-1)
    waves = torch.stack([torch.sin(angle), torch.cos(angle)], dim=-2)
    return torch.cat([x, waves.flatten(-3)], dim=-1)


def encode(x: Float[Tensor, "points axes"], base: float, bands: int) -> Float[Tensor, "points features"]:
    """Return `fourier_features(x, frequency_ladder(base, bands, x.dtype))`, bit-identical, as a transposed view, in
    which the points of a feature are adjacent in memory: that is faster.

    Raises `TypeError` unless `x` is float32 or float64. Where `x` needs a gradient, this calls `fourier_features`.
    """
    if x.dtype not in (torch.float32, torch.float64):
        raise TypeError(f"the encoding needs float32 or float64, got {x.dtype}: its upper bands would be noise")
    if x.requires_grad and torch.is_grad_enabled():
        return fourier_features(x, frequency_ladder(base, bands, x.dtype).to(x.device))
    points, axes = x.shape
    features = x.new_empty((feature_count(axes, bands), points))
    raw = features[:axes]
    # with a third dimension, as torch copies a tall matrix four times slower when it detects a transposition
    raw.unsqueeze(0).copy_(x.t().unsqueeze(0))
    sine, cosine = features[axes:].view(bands, 2, axes, points).unbind(1)
    torch.mul(_angular_frequencies(base, bands, x.dtype, x.device), raw, out=cosine)
    torch.sin(cosine, out=sine)
    cosine.cos_()
    return features.t()


@cache
def _angular_frequencies(base: float, bands: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Return f π, [bands, 1, 1], rounded as in `fourier_features`; cached, as it costs as much as 500 points."""
    return (math.pi * frequency_ladder(base, bands, dtype)).to(device).view(bands, 1, 1)
