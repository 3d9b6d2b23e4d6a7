"""Work counted in floating-point operations: an axis that does not depend on the machine.

Counted are the multiply-adds of linear maps, two operations each, as a network is written down: the concatenated view
direction counts at every point, although this implementation takes its half of the product once a ray. Encodings,
activations and the sums along a ray are left out; they are a few percent of it.
"""

from typing import Protocol, runtime_checkable

from torch import nn

CORNERS = 8
"""Voxels between which a point is interpolated."""
FORWARD_AND_BACKWARD = 3
"""A training step in forward passes: a layer's way back is two products of the size of its way there, one for its
weights and one for its inputs."""


@runtime_checkable
class Voxels(Protocol):
    """What is interpolated at a point: one density, and of each of three colours so many coefficients."""

    @property
    def coefficients(self) -> int: ...


def flops_per_evaluation(field: object) -> int | None:
    """Operations of one evaluation of `field` at one point, density and colour, forward; None where it is neither a
    network nor voxels.
    """
    if isinstance(field, nn.Module):
        layers = [one for one in field.modules() if isinstance(one, nn.Linear)]
        return 2 * sum(layer.in_features * layer.out_features for layer in layers) or None
    if isinstance(field, Voxels):
        colours = 3 * field.coefficients
        return 2 * CORNERS * (1 + colours) + 2 * (colours if field.coefficients > 1 else 0)
    return None


def training_flops(network_evaluations: float, per_evaluation: float) -> float:
    """Of so many evaluations in training. A little too much where an occupancy grid is refreshed, which goes forward
    alone and asks for density alone.
    """
    return FORWARD_AND_BACKWARD * network_evaluations * per_evaluation
