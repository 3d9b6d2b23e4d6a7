"""The part between the network's density output and the density that is rendered.

`AMPLIFIERS` names the readings. They return density in the unit of `baselines.composition.Parts.density_unit`, by which
the field multiplies. Each is made with a start: the density of a fresh field in that unit, reached by a shift of the
raw output. With None nothing is shifted, as the paper prints it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from baselines.held_mean import RunningMean
from baselines.numerics.amplifier import (
    amplify_about_mean,
    amplify_listing2,
    contrast_about,
    sigmoid_shift,
    softplus_density,
    softplus_shift,
)
from baselines.numerics.encoding import PHI


class Amplifier(nn.Module, ABC):
    """A reading that acts on the sigmoid of the raw output if it is bounded, and else on its softplus."""

    bounded: bool
    """Whether its output stays within [0, 1]."""
    pointwise: bool
    """Whether a rendered point's density does not depend on the other points of the chunk."""

    def __init__(self, start: float | None = None) -> None:
        super().__init__()
        self.shift = 0.0 if start is None else (sigmoid_shift if self.bounded else softplus_shift)(start)

    def quantity(self, raw: Float[Tensor, " points"]) -> Tensor:
        """Return the quantity [points] that is amplified."""
        return torch.sigmoid(raw + self.shift) if self.bounded else softplus_density(raw, self.shift)

    @abstractmethod
    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        """Return the density before and after the amplifier, both [points]; equal without one."""

    def rendered(self, raw: Float[Tensor, " points"], counted: Bool[Tensor, " points"] | None = None) -> Tensor:
        """Return the density [points] with which the renderer composites a chunk of these points; with `counted`, the
        other points are not part of the chunk, and their densities mean nothing.
        """
        return self.before_and_after(raw)[1]


class NoAmplifier(Amplifier):
    """Plain softplus: vanilla NeRF's density, with a gradient where ReLU would have none."""

    bounded = False
    pointwise = True

    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        sigma = self.quantity(raw)
        return sigma, sigma


class MeanAmplifier(Amplifier):
    """A contrast α about a mean of the field that only training steps update; if bounded, also β, applied above 0.5."""

    def __init__(self, start: float | None = None) -> None:
        super().__init__(start)
        self.mean = RunningMean()
        self.alpha = nn.Parameter(torch.tensor(1.0 / PHI))
        if self.bounded:
            self.beta = nn.Parameter(torch.tensor(1.0))

    def update_mean(self) -> None:
        self.mean.update()


class CallMeanAmplifier(MeanAmplifier):
    """An amplifier about the mean of the points that share a chunk of the renderer, as the paper prints both of its
    amplifiers.

    A pixel then depends on the chunk that it is rendered in. The occupancy grid and the histograms ask for the density
    of other points: they get it about the mean of the last training step, as in the rendered field.
    """

    pointwise = False

    @abstractmethod
    def about(self, quantity: Float[Tensor, " points"], mean: Float[Tensor, ""]) -> Tensor:
        """Return the density [points] about a given mean."""

    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        quantity = self.quantity(raw)
        mean = torch.where(self.mean.steps > 0, self.mean.value, _mean_of(quantity))
        return quantity, self.about(quantity, mean)

    def rendered(self, raw: Float[Tensor, " points"], counted: Bool[Tensor, " points"] | None = None) -> Tensor:
        quantity = self.quantity(raw)
        self.mean.observe(quantity, counted)
        return self.about(quantity, _mean_of(quantity, counted))

    def update_mean(self) -> None:
        self.mean.update(share=1.0)


def _mean_of(values: Float[Tensor, " points"], counted: Bool[Tensor, " points"] | None = None) -> Float[Tensor, ""]:
    if counted is not None:
        return torch.where(counted, values, 0.0).sum() / counted.sum().clamp(min=1)
    return values.mean() if values.numel() else values.new_zeros(())  # without points there is nothing to amplify


class Listing2Amplifier(CallMeanAmplifier):
    """Listing 2 as printed: sigmoid, Eq. 4 about the mean of the chunk, β above 0.5, clamp to [0, 1]."""

    bounded = True

    def about(self, quantity: Float[Tensor, " points"], mean: Float[Tensor, ""]) -> Tensor:
        return amplify_listing2(quantity, mean, self.alpha, self.beta)


class Equation4Amplifier(CallMeanAmplifier):
    """Theorem 1 (Eq. 4) on an unbounded softplus density, about the mean of the chunk; negative density becomes 0."""

    bounded = False

    def about(self, quantity: Float[Tensor, " points"], mean: Float[Tensor, ""]) -> Tensor:
        return amplify_about_mean(quantity, mean, self.alpha).clamp(min=0.0)


@contextmanager
def without_effect(amplifiers: Iterable[nn.Module | None]) -> Iterator[None]:
    """Enclose evaluations in which Eq. 4 changes nothing: α = 1/φ and β = 1, where a module has these scalars."""
    neutral = {"alpha": 1.0 / PHI, "beta": 1.0}
    before = [
        (scalar, scalar.detach().clone(), value)
        for amplifier in amplifiers
        for name, value in neutral.items()
        if isinstance(scalar := getattr(amplifier, name, None), nn.Parameter)
    ]
    try:
        with torch.no_grad():
            for scalar, _, value in before:
                scalar.fill_(value)
        yield
    finally:
        with torch.no_grad():
            for scalar, learnt, _ in before:
                scalar.copy_(learnt)


LARGEST_ALPHA = 1e3
"""The limit of α: a larger contrast is a step, and an α that grows without bound would make ∞ · 0."""


class HeldMeanAmplifier(MeanAmplifier):
    """Eq. 4 on NeRF's softplus density, about a running mean over the points that training evaluates."""

    bounded = False
    pointwise = True

    def before_and_after(self, raw: Float[Tensor, " points"]) -> tuple[Tensor, Tensor]:
        quantity = self.quantity(raw)
        return quantity, self._amplified(quantity, None)

    def rendered(self, raw: Float[Tensor, " points"], counted: Bool[Tensor, " points"] | None = None) -> Tensor:
        return self._amplified(self.quantity(raw), counted)

    def _amplified(self, quantity: Tensor, counted: Tensor | None) -> Tensor:
        self.mean.observe(quantity, counted)
        gain = self.alpha.clamp(-LARGEST_ALPHA, LARGEST_ALPHA) * PHI
        amplified = contrast_about(quantity, self.mean.value, gain)
        if not self.bounded:
            return amplified.clamp(min=0.0)
        boost = torch.where(quantity > 0.5, self.beta, torch.ones_like(self.beta))
        return torch.clamp(amplified * boost, 0.0, 1.0)


class HeldMeanListing2Amplifier(HeldMeanAmplifier):
    """The same on the sigmoid of Listing 2, with β above 0.5 and a limit of 1."""

    bounded = True


AMPLIFIERS: dict[str, Callable[[float | None], Amplifier]] = {
    "none": NoAmplifier,
    "listing2": Listing2Amplifier,
    "equation4": Equation4Amplifier,
    "running_mean": HeldMeanAmplifier,
    "running_mean_listing2": HeldMeanListing2Amplifier,
}
"""Map name → amplifier, as a function of its start.

none is NeRF's softplus; listing2 and equation4 are printed, with a mean of the chunk; the others are Eq. 4 and Listing
2 about a running mean that belongs to the field.
"""
