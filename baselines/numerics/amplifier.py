"""From the network's raw density output to density σ >= 0: the plain activation and the paper's two amplifiers.

The paper prints two different operators (Eq. 4 and Listing 2). Both take a mean over "the densities". The caller
decides which densities these are, so that the mean is an argument.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from baselines.numerics.encoding import PHI


def softplus_shift(start: float) -> float:
    """Return the shift before softplus that maps 0 to `start`. Raises `ValueError` unless `start` is above 0."""
    if not start > 0.0:
        raise ValueError(f"a start of {start}: the density of a fresh field must be above 0")
    return start + math.log(-math.expm1(-start))


def sigmoid_shift(start: float) -> float:
    """Return the shift before a sigmoid that maps 0 to `start`. Raises `ValueError` for a start outside (0, 1)."""
    if not 0.0 < start < 1.0:
        raise ValueError(f"a start of {start} units: a sigmoid lies between 0 and 1")
    return math.log(start / (1.0 - start))


def softplus_density(raw: Float[Tensor, "*points"], bias: float) -> Float[Tensor, "*points"]:
    """Return log(1 + exp(raw + bias)): positive, unbounded, with a gradient everywhere. Raises `TypeError` below
    float32: half precision ends at 65504 and has 3 digits.
    """
    _require_float32(raw)
    return torch.nn.functional.softplus(raw + bias)


def amplify_about_mean(
    sigma: Float[Tensor, "*points"], mean: Float[Tensor, ""], alpha: Float[Tensor, ""]
) -> Float[Tensor, "*points"]:
    """Return σ' = σ̄ + α φ (σ − σ̄), Eq. 4. It is the identity at α = 1/φ and may be negative."""
    _require_float32(sigma)
    return mean + alpha * (sigma - mean) * PHI


def contrast_about(
    values: Float[Tensor, "*points"], mean: Float[Tensor, ""], gain: Float[Tensor, ""]
) -> Float[Tensor, "*points"]:
    """Apply Eq. 4 with its gain αφ, summed in the order that at gain 1 leaves every bit as it is.

    `amplify_about_mean` rounds away values that are small compared with the mean.
    """
    _require_float32(values)
    return gain * values + (1.0 - gain) * mean


def amplify_listing2(
    normalised: Float[Tensor, "*points"],
    mean: Float[Tensor, ""],
    alpha: Float[Tensor, ""],
    beta: Float[Tensor, ""],
    threshold: float = 0.5,
) -> Float[Tensor, "*points"]:
    """Apply Listing 2 after its sigmoid: Eq. 4 on `normalised`, times β above the threshold, clamped to [0, 1].

    As a density it is at most 1 per unit of length, which the listing does not state. Per scene unit, one unit of solid
    geometry has an opacity of at most 1 − 1/e = 0.63; per 1/25 of a scene unit, 1 − e^(−25). The gradient is zero where
    the clamp acts.
    """
    amplified = amplify_about_mean(normalised, mean, alpha)
    boost = torch.where(normalised > threshold, beta, torch.ones_like(beta))
    return torch.clamp(amplified * boost, 0.0, 1.0)


def _require_float32(values: Tensor) -> None:
    if values.dtype in (torch.float16, torch.bfloat16):
        raise TypeError(f"the amplifier needs float32 or better, got {values.dtype}")
