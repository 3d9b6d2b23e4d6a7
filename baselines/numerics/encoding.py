"""Fourier features of positions and directions (paper Eq. 2 and Eq. 3, Listing 1).

`f` is a frequency ladder [bands], `x` coordinates [..., axes]. A ladder of base b is f_k = b^k, k = 0 … L−1;
the field's is base 2, the paper's is base φ.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

PHI = (1.0 + math.sqrt(5.0)) / 2.0


def frequency_ladder(base: float, bands: int) -> Float[Tensor, " bands"]:
    """f_k = base^k for k = 0 … bands − 1 (Eq. 2), rounded once from double precision."""
    if bands < 0:
        raise ValueError(f"bands must be >= 0, is {bands}")
    return torch.tensor([base**k for k in range(bands)], dtype=torch.float64).to(torch.get_default_dtype())


def matched_bands(base: float, bands: int) -> int:
    """How many bands 2^k, k = 0 …, reach as far as base^(bands − 1) and no further: the bandwidth control."""
    return 1 + math.floor((bands - 1) * math.log2(base))


def feature_count(axes: int, bands: int) -> int:
    """Width of `fourier_features`: the raw coordinates and a sine and a cosine for each band and axis."""
    return axes * (1 + 2 * bands)


def fourier_features(x: Float[Tensor, "*batch axes"], f: Float[Tensor, " bands"]) -> Float[Tensor, "*batch features"]:
    """[x, sin(f_0 π x), cos(f_0 π x), …, cos(f_{L−1} π x)] as Listing 1; no bands give x itself.

    Float32 at |x| <= 1: absolute error below 1.2e-4 at 2^9 and 1.2e-5 at φ^9, from rounding f π x. Reduced
    precision would lose the upper bands altogether (error 1.0 in bfloat16), so this runs in float32 or better.
    """
    if x.dtype in (torch.float16, torch.bfloat16):
        raise TypeError(f"the encoding needs float32 or better, got {x.dtype}: its upper bands would be noise")
    angle = x.unsqueeze(-2) * (math.pi * f).to(x.dtype).unsqueeze(-1)
    waves = torch.stack([torch.sin(angle), torch.cos(angle)], dim=-2)
    return torch.cat([x, waves.flatten(-3)], dim=-1)
