"""A running mean of weights, so that scores during training do not depend on the last few steps.

The mean over a fixed share of the past (Karras et al. 2024, arXiv 2312.02696, § 3.1: power function EMA): after step t

    mean ← mean + w (weights − mean),   w = 1 − (1 − 1/t)^(power + 1),

in which step s has about the weight (s / t)^power. At a high learning rate the mean is better than the weights, nearly
as good as if the rate had been lowered by then. So a curve over training is nearer to the scores that shorter trainings
would have had.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import torch
from torch import Tensor, nn


class WeightAverage:
    """The mean of some weights over their training."""

    def __init__(self, weights: Iterable[nn.Parameter], power: float) -> None:
        self.weights = list(weights)
        self.means = [weight.detach().clone() for weight in self.weights]
        self.power = power
        self.observed = 0

    @torch.no_grad()
    def observe(self) -> None:
        self.observed += 1
        share = 1.0 - (1.0 - 1.0 / self.observed) ** (self.power + 1.0)
        torch._foreach_lerp_(self.means, [weight.detach() for weight in self.weights], share)

    @torch.no_grad()
    def adopt(self) -> None:
        """Set the weights to their mean permanently."""
        torch._foreach_copy_([weight.detach() for weight in self.weights], self.means)

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Enclose code for which the weights are their mean."""
        own = [weight.data for weight in self.weights]
        for weight, mean in zip(self.weights, self.means, strict=True):
            weight.data = mean
        try:
            yield
        finally:
            for weight, data in zip(self.weights, own, strict=True):
                weight.data = data

    def tensors(self) -> dict[str, Tensor]:
        return {**{str(place): mean for place, mean in enumerate(self.means)}, "observed": torch.tensor(self.observed)}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        """Restore what `tensors` returned; raises `KeyError` or `RuntimeError` for the state of other weights."""
        for place, mean in enumerate(self.means):
            if tensors[str(place)].shape != mean.shape:
                raise RuntimeError(f"mean {place} of {tuple(tensors[str(place)].shape)}, not {tuple(mean.shape)}")
            mean.copy_(tensors[str(place)])
        self.observed = int(tensors["observed"])
