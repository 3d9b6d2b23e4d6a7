"""Fourier features of positions and directions (paper Eq. 2 and Eq. 3, Listing 1).

`f` is a frequency ladder [bands], `x` coordinates [..., axes]. A ladder of base b is f_k = b^k, k = 0 … L−1;
NeRF has base 2, the paper base φ. `encode` gives the same features faster; `fourier_features` is its oracle.
"""

import math
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

PHI = (1.0 + math.sqrt(5.0)) / 2.0

MOST_RECURRENT_BANDS = {2.0: 20, PHI: 12}
"""The maximum number of bands by recurrence per base: at φ^12 a sine is 3.3 times as accurate."""
DOUBLINGS = 4
"""The doublings between two sines of base 2: if all bands came from one sine, no digit would be right at 2^16."""

REACH = 1.0001
"""The largest coordinate for which the errors stated here hold: rays are cut to the box, which rounds by 1e-6."""

BLOCK = 1 << 14
"""The points that the recurrences process at a time: at 65536 points this saves φ a quarter of its time."""


def frequency_ladder(base: float, bands: int, dtype: torch.dtype | None = None) -> Float[Tensor, " bands"]:
    """Return f_k = base^k for k = 0 … bands − 1 (Eq. 2), rounded once from double precision."""
    if bands < 0:
        raise ValueError(f"bands must be >= 0, is {bands}")
    return torch.tensor([base**k for k in range(bands)], dtype=torch.float64).to(dtype or torch.get_default_dtype())


def matched_bands(base: float, bands: int) -> int:
    """Return the largest number of bands of 2^k that reach no further than base^(bands − 1): the bandwidth control."""
    return 1 + math.floor((bands - 1) * math.log2(base))


def feature_count(axes: int, bands: int) -> int:
    """Return the width of `fourier_features`: the raw coordinates and a sine and a cosine for each band and axis."""
    return axes * (1 + 2 * bands)


def checked_positions(x: Float[Tensor, "points axes"], reach: float = REACH) -> Float[Tensor, "points axes"]:
    """Return `x` itself. Raises `ValueError` naming the first point with a coordinate that is not finite or beyond
    `reach`.

    This is for callers whose points do not come from rays cut to the box (slices, meshes, probes). The error of an
    angle f π x grows in proportion to x: at x = 1e4 the top band of base 2 is noise (error 0.8), at 1e36 it is NaN.
    """
    allowed = (x.abs() <= reach).all(dim=-1)  # a NaN compares as not allowed
    if not bool(allowed.all()):
        point = int(allowed.int().argmin())
        raise ValueError(
            f"point {point} at {x[point].tolist()} is not in the box, whose coordinates end at ±{reach:g}; "
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
    angle = x.unsqueeze(-2) * (math.pi * f).to(x.dtype).unsqueeze(-1)
    waves = torch.stack([torch.sin(angle), torch.cos(angle)], dim=-2)
    return torch.cat([x, waves.flatten(-3)], dim=-1)


def recurrence_is_accurate(base: float, bands: int) -> bool:
    """Return whether no band's worst error at |x| <= 1 in float32 exceeds 2.5 times that of a direct sine.

    Both grow like the frequency: sines round f π x, and the recurrences pass errors on to higher bands. At ten bands
    the error is 1.1e-4 for base 2 (sine 1.1e-4) and 2.2e-5 for φ (sine 1.1e-5). Other bases have no recurrence.
    """
    return bands <= MOST_RECURRENT_BANDS.get(base, -1)


def encode(
    x: Float[Tensor, "points axes"], base: float, bands: int, recurrence: bool = True
) -> Float[Tensor, "points features"]:
    """Return `fourier_features(x, frequency_ladder(base, bands, x.dtype))` as a transposed view, in which the points of
    a feature are adjacent in memory.

    With `recurrence`, bands are computed from lower bands where `recurrence_is_accurate`; otherwise the result is
    bit-identical to `fourier_features`. Most of the gain comes from the layout; the recurrence pays from about 4000
    points on. The absolute error at |x| <= 1 is below 1.2e-4 at 2^9 and 2.5e-5 at φ^9.

    Raises `TypeError` unless `x` is float32 or float64. Where `x` needs a gradient, this calls `fourier_features`.
    """
    if x.dtype not in (torch.float32, torch.float64):
        raise TypeError(f"the encoding needs float32 or float64, got {x.dtype}: its upper bands would be noise")
    if x.requires_grad and torch.is_grad_enabled():
        return fourier_features(x, frequency_ladder(base, bands, x.dtype).to(x.device))
    points, axes = x.shape
    angular = _angular_frequencies(base, bands, x.dtype, x.device)
    features = x.new_empty((feature_count(axes, bands), points))
    raw = features[:axes]
    # with a third dimension, as torch copies a tall matrix four times slower when it detects a transposition
    raw.unsqueeze(0).copy_(x.t().unsqueeze(0))
    waves = features[axes:].view(bands, 2, axes, points)
    if not (recurrence and recurrence_is_accurate(base, bands)):
        _sines(waves, raw, angular)
        return features.t()
    recur = _golden_sums if base == PHI else _doublings
    # in blocks the lower bands stay in a processor's cache; elsewhere more and smaller launches only cost time
    size = BLOCK if x.device.type == "cpu" else points
    if points <= size:
        recur(waves, raw, angular)
        return features.t()
    for block, raw_block in zip(waves.split(size, -1), raw.split(size, -1), strict=True):
        recur(block, raw_block, angular)
    return features.t()


def _sines(waves: Tensor, raw: Tensor, angular: Tensor) -> None:
    """Write sines and cosines of angular [bands, 1, 1] times raw [axes, points] into waves [bands, 2, axes, points]."""
    sine, cosine = waves.unbind(1)
    torch.mul(angular, raw, out=cosine)
    torch.sin(cosine, out=sine)
    cosine.cos_()


def _golden_sums(waves: Tensor, raw: Tensor, angular: Tensor) -> None:
    """Compute bands from φ^k = φ^(k−1) + φ^(k−2): with a, b the angles of the two bands below,

    sin(a + b) = sin(a − b) + 2 cos a sin b and cos(a + b) = cos(a − b) − 2 sin a sin b, where a − b is band k − 3.
    The addition formula itself takes twice the operations and costs more than sines, so it gives only band 2. That band
    must not be a direct sine: with three angles rounded separately the error is 5 times as large at φ^9, and has no
    bound far outside the box.
    """
    _sines(waves[:2], raw, angular[:2])
    sine, cosine = (wave.unbind(0) for wave in waves.unbind(1))
    if len(waves) > 2:
        torch.mul(sine[1], cosine[0], out=sine[2]).addcmul_(cosine[1], sine[0])
        torch.mul(cosine[1], cosine[0], out=cosine[2]).addcmul_(sine[1], sine[0], value=-1)
    for k in range(3, len(waves)):
        torch.addcmul(sine[k - 3], cosine[k - 1], sine[k - 2], value=2, out=sine[k])
        torch.addcmul(cosine[k - 3], sine[k - 1], sine[k - 2], value=-2, out=cosine[k])


def _doublings(waves: Tensor, raw: Tensor, angular: Tensor) -> None:
    """Apply sin 2a = 2 sin a cos a, cos 2a = 1 − 2 sin² a, starting from a direct sine at each fifth band, all fifth
    bands at once.

    cos 2a = 2 cos² a − 1 would multiply the error by 4 in every doubling near a = 0, where every upper band starts.
    """
    stride = 1 + DOUBLINGS
    nought, unity = _constants(raw.dtype, raw.device)
    lower = waves[::stride]
    _sines(lower, raw, angular[::stride])
    for k in range(1, min(stride, len(waves))):
        upper = waves[k::stride]
        sine, cosine = lower[: len(upper)].unbind(1)
        upper_sine, upper_cosine = upper.unbind(1)
        torch.addcmul(nought, sine, cosine, value=2, out=upper_sine)
        torch.addcmul(unity, sine, sine, value=-2, out=upper_cosine)
        lower = upper


@lru_cache(maxsize=64)
def _angular_frequencies(base: float, bands: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    """Return f π, [bands, 1, 1], rounded as in `fourier_features`; cached, as it costs as much as 500 points."""
    return (math.pi * frequency_ladder(base, bands, dtype)).to(device).view(bands, 1, 1)


@lru_cache(maxsize=16)
def _constants(dtype: torch.dtype, device: torch.device) -> tuple[Tensor, Tensor]:
    return torch.zeros((), dtype=dtype, device=device), torch.ones((), dtype=dtype, device=device)
