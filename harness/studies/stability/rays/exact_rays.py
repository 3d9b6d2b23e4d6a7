"""References that share no code with the rules: rays with exact results, and quadrature sums in 40 digits."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import mpmath
import torch
from torch import Tensor

from baselines.numerics.quadrature import QUADRATURES
from harness.records.study import Owner

Real = Any
"""A number of mpmath, which has no types."""

DIGITS = 40
OURS = [name for name, rule in QUADRATURES.items() if not rule.of_the_paper]
MOST_SLOPE = 1.5
"""The maximum of |c′| of `colour`."""


def owner_of(rule: str) -> Owner:
    return "paper" if QUADRATURES[rule].of_the_paper else "ours"


@dataclass(frozen=True)
class FunctionField:
    """A field (`baselines.contract.RadianceField`) from two functions of points [points, 3]."""

    density: Callable[[Tensor], Tensor]
    colour: Callable[[Tensor], Tensor]
    pointwise: bool = True

    def encode_directions(self, d: Tensor) -> Tensor:
        return d[:, :0]

    def density_before_and_after(self, x: Tensor) -> tuple[Tensor, Tensor]:
        return self.density(x), self.density(x)

    def density_and_colour(self, x: Tensor, view: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
        return self.density(x), self.colour(x)


@dataclass(frozen=True)
class Profile:
    """A density on [0, 1], for torch, and the optical depth in front of each point, for mpmath."""

    name: str
    sigma: Callable[[Tensor], Tensor]
    depth: Callable[[Real], Real]
    layer: float
    """The length over which most light is lost: the reference integrates more finely there."""


def colour(t: Tensor) -> Tensor:
    """Return the colour of all profiles: smooth, in [0, 1], |c′| ≤ 1.5, and steep where the ray begins."""
    return 0.5 + 0.5 * torch.cos(3.0 * t + 0.5)


def homogeneous(tau: float) -> Profile:
    return Profile(f"homogeneous, τ = {tau:g}", lambda t: torch.full_like(t, tau), lambda t: tau * t, min(1.0, 1 / tau))


def ramp(tau: float) -> Profile:
    return Profile(f"ramp, τ = {tau:g}", lambda t: 2 * tau * t, lambda t: tau * t**2, min(1.0, tau**-0.5))


def exponential(tau: float, rate: float = 3.0) -> Profile:
    scale = tau / float(-mpmath.expm1(-rate))
    return Profile(
        f"exponential, τ = {tau:g}",
        lambda t: scale * rate * torch.exp(-rate * t),
        lambda t: scale * -mpmath.expm1(-rate * t),
        min(1.0, 1.0 / (scale * rate)),
    )


def gaussian(tau: float, centre: float = 0.5, width: float = 0.15) -> Profile:
    def below(t: Real) -> Real:
        return mpmath.erf((t - centre) / (width * mpmath.sqrt(2)))

    scale = tau / float(below(mpmath.mpf(1)) - below(mpmath.mpf(0)))
    peak = 2 * scale / float(width * mpmath.sqrt(2 * mpmath.pi))
    return Profile(
        f"Gaussian, τ = {tau:g}",
        lambda t: peak * torch.exp(-0.5 * ((t - centre) / width) ** 2),
        lambda t: scale * (below(t) - below(mpmath.mpf(0))),
        1.0,
    )


@cache
def exact(profile: Profile) -> tuple[float, float]:
    """Return opacity A(1) and colour ∫ c dA = c(1) A(1) − ∫ c′ A dt with A = 1 − exp(−τ(t)), by mpmath."""
    with mpmath.workdps(20):

        def opacity(t: Real) -> Real:
            return -mpmath.expm1(-profile.depth(t))

        def moved(t: Real) -> Real:
            return mpmath.mpf(1.5) * mpmath.sin(3 * t + 0.5) * opacity(t)

        cuts = [mpmath.mpf(0), *(profile.layer * 4.0**k for k in range(-1, 12) if profile.layer * 4.0**k < 0.9)]
        cuts = sorted({*cuts, *(mpmath.mpf(k) / 6 for k in range(1, 7))})
        total = opacity(mpmath.mpf(1))
        seen = (1 + mpmath.cos(mpmath.mpf(3.5))) / 2 * total
        return float(total), float(seen + mpmath.quad(moved, cuts, method="gauss-legendre", maxdegree=4))


def weights_in_digits(rule: str, sigma: Sequence[Real], lengths: Sequence[Real]) -> list[Real]:
    """Return the weights of one ray and, last, T_end, by the definition of a rule, in mpmath numbers."""
    stride, closed = QUADRATURES[rule].stride, QUADRATURES[rule].closed
    w = [mpmath.mpf(0)] * (stride * len(lengths) + closed)
    T = mpmath.mpf(1)
    for i, length in enumerate(lengths):
        at = sigma[stride * i : stride * (i + 1) + closed]
        tau = ((at[0] + 4 * at[1] + at[2]) / 6 if len(at) == 3 else sum(at) / len(at)) * length
        E = mpmath.exp(-tau)
        second = -mpmath.expm1(-tau) / 2 if closed else mpmath.mpf(0)
        if rule == "linear":
            second = (1 - E * (1 + tau)) / tau if tau else mpmath.mpf(0)
        w[stride * i] += T * (-mpmath.expm1(-tau) - second)
        if closed:
            w[stride * (i + 1)] += T * second
        T *= E
    return [*w, T]
