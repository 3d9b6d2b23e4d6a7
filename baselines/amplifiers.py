"""The part between the network's density output and the density that is rendered.

`AMPLIFIERS` names the readings; each is a small module with its own learnable scalars, or none.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import softplus

from baselines.held_mean import HeldMean
from baselines.numerics.amplifier import amplify_about_mean, amplify_listing2, contrast_about, softplus_density
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

    def begin_step(self) -> None:
        """A training step begins: a mean that belongs to the field takes in what is evaluated from here on."""

    def end_step(self, raw_in_box: Callable[[], Tensor]) -> None:
        """It has ended: such a mean moves. `raw_in_box` gives raw densities at fixed points all over the box."""

    def drop_step(self) -> None:
        """It was left by an error: such a mean stays where it was."""


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


LARGEST_ALPHA = 1e3
"""A contrast beyond it is a step; without a limit an α that runs away makes ∞ · 0."""
LEAST_TRANSMITTANCE = 1e-6
"""Of 1 / DENSITY_SCALE of a unit, where density is read from an opacity: it ends at 345 a unit."""
KAPPA = 100.0
"""Density, in 1 / scene unit, that is 1 to Listing 2: a tenth of a unit of it has an opacity of 0.99995."""


@dataclass(frozen=True)
class Reading:
    """What Eq. 4 acts on, and how that is a density."""

    quantity: Callable[[Tensor], Tensor]
    """Of the network's raw output [points]."""
    density: Callable[[Tensor], Tensor]
    """Of the quantity, before or after Eq. 4; takes whatever Eq. 4 makes of it, gives density >= 0."""
    threshold: float = math.inf
    """Of the quantity, above which β boosts where a reading has it."""


def _kappa_bias() -> float:
    """Where a sigmoid has the density of a fresh field of all other methods: no reading gets a start of its own."""
    share = DENSITY_SCALE * math.log1p(math.exp(DENSITY_BIAS)) / KAPPA
    return math.log(share / (1.0 - share))


READINGS = {
    "density": Reading(
        lambda raw: softplus_density(raw, DENSITY_BIAS, DENSITY_SCALE),
        lambda sigma: sigma.clamp(min=0.0),
        DENSITY_SCALE * math.log(2.0),
    ),
    "preactivation": Reading(lambda raw: raw + DENSITY_BIAS, lambda z: DENSITY_SCALE * softplus(z)),
    # softplus(z) is −log of the sigmoid of −z: the transmittance of 1 / DENSITY_SCALE of a unit
    "opacity": Reading(
        lambda raw: torch.sigmoid(-(raw + DENSITY_BIAS)),
        lambda through: -DENSITY_SCALE * torch.log(through.clamp(LEAST_TRANSMITTANCE, 1.0)),
    ),
    "kappa": Reading(lambda raw: torch.sigmoid(raw + _kappa_bias()), lambda share: KAPPA * share.clamp(0.0, 1.0), 0.5),
}
"""density        the density of NeRF, as Eq. 4 is printed; negative becomes 0
preactivation  what softplus makes a density of
opacity        the [0, 1] of Listing 2 read as the opacity of a short length, of which density follows
kappa          the [0, 1] of Listing 2 times a density that is opaque
"""


class HeldMeanAmplifier(Amplifier):
    """Eq. 4 about a mean that belongs to the field: density is a function of the point alone, whatever shares the call.

    `boost` multiplies by β above the threshold, as Listing 2 does; `positive` keeps α above 0; `over_box` takes the
    mean over fixed points of the box, otherwise it is that of the points which training evaluates.
    """

    bounded = False
    pointwise = True

    def __init__(self, reading: str, boost: bool = False, positive: bool = False, over_box: bool = False) -> None:
        super().__init__()
        self.reading = READINGS[reading]
        self.over_box = over_box
        self.mean = HeldMean()
        if positive:
            self.rho = nn.Parameter(torch.zeros(()))
        else:
            self.free_alpha = nn.Parameter(torch.tensor(1.0 / PHI))
        if boost:
            self.beta = nn.Parameter(torch.tensor(1.0))

    @property
    def alpha(self) -> Tensor:
        """1/φ at first, in either form."""
        return self.free_alpha if hasattr(self, "free_alpha") else softplus(self.rho) / (math.log(2.0) * PHI)

    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        quantity = self.reading.quantity(raw)
        self.mean.take(quantity)
        gain = self.alpha.clamp(-LARGEST_ALPHA, LARGEST_ALPHA) * PHI
        amplified = contrast_about(quantity, self.mean.value, gain)
        if hasattr(self, "beta"):
            amplified = amplified * torch.where(quantity > self.reading.threshold, self.beta, 1.0)
        return self.reading.density(quantity), self.reading.density(amplified)

    def begin_step(self) -> None:
        self.mean.begin()

    def end_step(self, raw_in_box: Callable[[], Tensor]) -> None:
        if self.over_box:
            self.mean.set(self.reading.quantity(raw_in_box()).mean())
        else:
            self.mean.move()

    def drop_step(self) -> None:
        self.mean.drop()


AMPLIFIERS: dict[str, Callable[[], Amplifier]] = {
    "none": NoAmplifier,
    "listing2": Listing2Amplifier,
    "equation4": Equation4Amplifier,
    "running_mean": partial(HeldMeanAmplifier, "density"),
    "running_mean_preactivation": partial(HeldMeanAmplifier, "preactivation"),
    "running_mean_positive": partial(HeldMeanAmplifier, "density", positive=True),
    "box_mean": partial(HeldMeanAmplifier, "density", over_box=True),
    "running_mean_boost": partial(HeldMeanAmplifier, "density", boost=True),
    "running_mean_opacity": partial(HeldMeanAmplifier, "opacity"),
    "running_mean_kappa": partial(HeldMeanAmplifier, "kappa", boost=True),
}
"""none … equation4 as printed, with a mean of the call; the others about a mean that belongs to the field."""
