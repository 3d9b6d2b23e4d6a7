"""The part between the network's density output and the density that is rendered.

`AMPLIFIERS` names the readings; each is a small module with its own learnable scalars, or none. They return density in
the unit of `baselines.composition.Parts.density_unit`, which the field multiplies by: no reading has a unit of its own.
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

from baselines.held_mean import RunningMean
from baselines.numerics.amplifier import amplify_about_mean, amplify_listing2, contrast_about, softplus_density
from baselines.numerics.encoding import PHI

DENSITY_BIAS = -4.4
"""A shift before softplus: a fresh field is thin fog (0.012 of the unit), light reaches everything, nothing saturates.
Listing 2 as printed has none; `nerf_no_shift` measures what it is worth.
"""


class Amplifier(nn.Module, ABC):
    """The interface of every reading; the classes below are final."""

    bounded: bool
    """Whether its output stays within [0, 1]."""
    pointwise: bool
    """Whether a rendered point's density does not depend on the other points of the chunk."""

    @abstractmethod
    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        """The density entering the amplifier and the density leaving it, both [points]; equal without one."""

    def rendered(self, raw: Float[Tensor, " points"]) -> Tensor:
        """Return the density [points] with which the renderer composites a chunk of these points."""
        return self.before_and_after(raw)[1]


class NoAmplifier(Amplifier):
    """Plain softplus: vanilla NeRF's density, with a gradient where ReLU would have none."""

    bounded = False
    pointwise = True

    def __init__(self, bias: float = DENSITY_BIAS) -> None:
        super().__init__()
        self.bias = bias

    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        sigma = softplus_density(raw, self.bias)
        return sigma, sigma


class MeanAmplifier(Amplifier):
    """An amplifier with a mean that belongs to the field, which training steps alone update."""

    def __init__(self) -> None:
        super().__init__()
        self.mean = RunningMean()

    def update_mean(self, raw_in_box: Callable[[], Tensor]) -> None:
        """End a step. `raw_in_box` returns raw densities at fixed points all over the box."""
        self.mean.update()


class CallMeanAmplifier(MeanAmplifier):
    """An amplifier about the mean of the points that share a chunk of the renderer, as the paper prints both of its
    own.

    A pixel then depends on the chunk that it is rendered in. Whatever asks for density alone – the occupancy grid, a
    histogram – asks about other points, whose mean is another one: it gets the density about the mean that training
    rendered with last, so that it sees the field that is rendered.
    """

    pointwise = False

    def __init__(self) -> None:
        super().__init__()
        self.alpha = nn.Parameter(torch.tensor(1.0 / PHI))

    @abstractmethod
    def quantity(self, raw: Float[Tensor, " points"]) -> Tensor:
        """Return the quantity [points] that the mean is taken over."""

    @abstractmethod
    def about(self, quantity: Float[Tensor, " points"], mean: Float[Tensor, ""]) -> Tensor:
        """Return the density [points] about a given mean."""

    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        quantity = self.quantity(raw)
        mean = torch.where(self.mean.steps > 0, self.mean.value, _mean_of(quantity))
        return quantity, self.about(quantity, mean)

    def rendered(self, raw: Float[Tensor, " points"]) -> Tensor:
        quantity = self.quantity(raw)
        self.mean.observe(quantity)
        return self.about(quantity, _mean_of(quantity))

    def update_mean(self, raw_in_box: Callable[[], Tensor]) -> None:
        self.mean.update(share=1.0)


def _mean_of(values: Float[Tensor, " points"]) -> Float[Tensor, ""]:
    """The mean; 0 for no points, whose mean would be 0/0: there is nothing to amplify either."""
    return values.mean() if values.numel() else values.new_zeros(())


class Listing2Amplifier(CallMeanAmplifier):
    """Listing 2 as printed: sigmoid, Eq. 4 about the mean of the chunk, β above 0.5, clamp to [0, 1]."""

    bounded = True

    def __init__(self) -> None:
        super().__init__()
        self.beta = nn.Parameter(torch.tensor(1.0))

    def quantity(self, raw: Float[Tensor, " points"]) -> Tensor:
        return torch.sigmoid(raw)

    def about(self, quantity: Float[Tensor, " points"], mean: Float[Tensor, ""]) -> Tensor:
        return amplify_listing2(quantity, mean, self.alpha, self.beta)


class Equation4Amplifier(CallMeanAmplifier):
    """Theorem 1 (Eq. 4) on an unbounded softplus density, about the mean of the chunk; negative density becomes 0."""

    bounded = False

    def quantity(self, raw: Float[Tensor, " points"]) -> Tensor:
        return softplus_density(raw, DENSITY_BIAS)

    def about(self, quantity: Float[Tensor, " points"], mean: Float[Tensor, ""]) -> Tensor:
        return amplify_about_mean(quantity, mean, self.alpha).clamp(min=0.0)


LARGEST_ALPHA = 1e3
"""A contrast beyond it is a step; without a limit an α that runs away makes ∞ · 0."""
LEAST_TRANSMITTANCE = 1e-6
"""The least transmittance of a length in which density 1 is an optical depth of 1, where density is read from an
opacity: density ends at 13.8."""


@dataclass(frozen=True)
class Reading:
    """The quantity that Eq. 4 acts on, and how it becomes a density."""

    quantity: Callable[[Tensor], Tensor]
    """Map the network's raw output [points] to the quantity."""
    density: Callable[[Tensor], Tensor]
    """Map the quantity, before or after Eq. 4, to a density >= 0; any value that Eq. 4 produces is accepted."""
    threshold: float = math.inf
    """The threshold of the quantity above which β boosts, for readings that boost."""


_FOG = math.log1p(math.exp(DENSITY_BIAS))
"""The density of NeRF's fresh field."""

READINGS = {
    "density": Reading(
        lambda raw: softplus_density(raw, DENSITY_BIAS), lambda sigma: sigma.clamp(min=0.0), math.log(2.0)
    ),
    "preactivation": Reading(lambda raw: raw + DENSITY_BIAS, softplus),
    # softplus(z) is −log of the sigmoid of −z: the transmittance of a length in which density 1 is optical depth 1
    "opacity": Reading(
        lambda raw: torch.sigmoid(-(raw + DENSITY_BIAS)),
        lambda through: -torch.log(through.clamp(LEAST_TRANSMITTANCE, 1.0)),
    ),
    "listing2": Reading(torch.sigmoid, lambda share: share.clamp(0.0, 1.0), 0.5),
    "listing2_shifted": Reading(
        lambda raw: torch.sigmoid(raw + math.log(_FOG / (1.0 - _FOG))), lambda share: share.clamp(0.0, 1.0), 0.5
    ),
}
"""density           the density of NeRF, as Eq. 4 is printed; negative becomes 0
preactivation     the input of softplus
opacity           the [0, 1] of Listing 2 read as the opacity of a short length, from which density follows
listing2          the [0, 1] of Listing 2 as it is printed
listing2_shifted  the same with the start that NeRF's density has
"""


class HeldMeanAmplifier(MeanAmplifier):
    """Eq. 4 about a mean that belongs to the field: density is a function of the point alone.

    `boost` multiplies by β above the threshold, as Listing 2 does; `positive` keeps α above 0; `over_box` takes the
    mean over fixed points of the box, otherwise it is that of the points which training evaluates.
    """

    pointwise = True

    def __init__(self, reading: str, boost: bool = False, positive: bool = False, over_box: bool = False) -> None:
        super().__init__()
        self.reading = READINGS[reading]
        self.bounded = reading.startswith("listing2")
        self.over_box = over_box
        if positive:
            self.rho = nn.Parameter(torch.zeros(()))
        else:
            self.free_alpha = nn.Parameter(torch.tensor(1.0 / PHI))
        if boost:
            self.beta = nn.Parameter(torch.tensor(1.0))

    @property
    def alpha(self) -> Tensor:
        """The contrast α, 1/φ at first in either form."""
        return self.free_alpha if hasattr(self, "free_alpha") else softplus(self.rho) / (math.log(2.0) * PHI)

    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        quantity = self.reading.quantity(raw)
        self.mean.observe(quantity)
        gain = self.alpha.clamp(-LARGEST_ALPHA, LARGEST_ALPHA) * PHI
        amplified = contrast_about(quantity, self.mean.value, gain)
        if hasattr(self, "beta"):
            amplified = amplified * torch.where(quantity > self.reading.threshold, self.beta, 1.0)
        return self.reading.density(quantity), self.reading.density(amplified)

    def update_mean(self, raw_in_box: Callable[[], Tensor]) -> None:
        if self.over_box:
            self.mean.set(self.reading.quantity(raw_in_box()).mean())
        else:
            self.mean.update()


AMPLIFIERS: dict[str, Callable[[], Amplifier]] = {
    "none": NoAmplifier,
    "none_unshifted": partial(NoAmplifier, 0.0),
    "listing2": Listing2Amplifier,
    "equation4": Equation4Amplifier,
    "running_mean": partial(HeldMeanAmplifier, "density"),
    "running_mean_preactivation": partial(HeldMeanAmplifier, "preactivation"),
    "running_mean_positive": partial(HeldMeanAmplifier, "density", positive=True),
    "box_mean": partial(HeldMeanAmplifier, "density", over_box=True),
    "running_mean_boost": partial(HeldMeanAmplifier, "density", boost=True),
    "running_mean_opacity": partial(HeldMeanAmplifier, "opacity"),
    "running_mean_listing2": partial(HeldMeanAmplifier, "listing2", boost=True),
    "running_mean_listing2_shifted": partial(HeldMeanAmplifier, "listing2_shifted", boost=True),
}
"""The amplifiers by name.

none and none_unshifted are NeRF's softplus with and without its shift; listing2 and equation4 are printed, with a
mean of the chunk; the others are about a mean that belongs to the field.
"""
