"""The part between the network's density output and the density that is rendered.

`AMPLIFIERS` names the readings; each is a small module with its own learnable scalars, or none.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor, nn

from baselines.numerics.amplifier import amplify_about_mean, amplify_listing2, softplus_density
from baselines.numerics.encoding import PHI

DENSITY_SCALE = 25.0
"""Density per unit of softplus output, in 1 / scene unit: a solid surface is within reach of ordinary weights."""
DENSITY_BIAS = -4.4
"""Shift before softplus: a fresh field is thin fog (0.3 per unit), light reaches everything, nothing saturates."""


class Amplifier(nn.Module, ABC):
    """What every reading supplies; the classes below are final."""

    bounded: bool
    """Whether density stays within [0, 1]."""
    pointwise: bool
    """Whether a point's density does not depend on the other points of the call."""

    @abstractmethod
    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        """The density entering the amplifier and the density that is rendered, both [points]; equal without one."""


class NoAmplifier(Amplifier):
    """Plain softplus: vanilla NeRF's density, with a gradient where ReLU would have none."""

    bounded = False
    pointwise = True

    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        sigma = softplus_density(raw, DENSITY_BIAS, DENSITY_SCALE)
        return sigma, sigma


class Listing2Amplifier(Amplifier):
    """Listing 2 as printed: sigmoid, Eq. 4 about the mean of the call, β above 0.5, clamp to [0, 1].

    The mean runs over whatever points share the call, so the field depends on the chunk; density is bounded by 1.
    """

    bounded = True
    pointwise = False

    def __init__(self) -> None:
        super().__init__()
        self.alpha = nn.Parameter(torch.tensor(1.0 / PHI))
        self.beta = nn.Parameter(torch.tensor(1.0))

    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        normalised = torch.sigmoid(raw)
        # the mean of no points is 0/0; without points there is nothing to amplify either
        mean = normalised.mean() if normalised.numel() else normalised.new_zeros(())
        return normalised, amplify_listing2(normalised, mean, self.alpha, self.beta)


class Equation4Amplifier(Amplifier):
    """Theorem 1 (Eq. 4) on an unbounded softplus density, about the mean of the call; negative density becomes 0."""

    bounded = False
    pointwise = False

    def __init__(self) -> None:
        super().__init__()
        self.alpha = nn.Parameter(torch.tensor(1.0 / PHI))

    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        sigma = softplus_density(raw, DENSITY_BIAS, DENSITY_SCALE)
        mean = sigma.mean() if sigma.numel() else sigma.new_zeros(())
        return sigma, amplify_about_mean(sigma, mean, self.alpha).clamp(min=0.0)


AMPLIFIERS: dict[str, Callable[[], Amplifier]] = {
    "none": NoAmplifier,
    "listing2": Listing2Amplifier,
    "equation4": Equation4Amplifier,
}
