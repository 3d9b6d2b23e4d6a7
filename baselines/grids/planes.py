"""Three axis-aligned planes of features at several resolutions, multiplied.

K-Planes (Fridovich-Keil et al. 2023, arXiv 2301.10241) for a scene at rest, with the hybrid decoder.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import grid_sample

from baselines.contract import FieldSpec, uniform_weights
from baselines.grids.feature_field import FeatureField, compiles_for
from baselines.grids.interpolation import PLANE_CHANNELS, Multiplied

RATE = 3.0
"""How many times as fast as the network's weights the features are learnt: a feature is RATE times what is stored."""
FIRST, SPREAD = 0.3, 0.2
"""The middle and the half-width of the first features: never 0, where a product has no gradient."""


class Planes(nn.Module):
    """Points −1 … 1 to the products of what lies at them on three planes, of each resolution."""

    def __init__(self, nodes: tuple[int, ...], seed: int | str) -> None:
        super().__init__()
        self.scales = nn.ParameterList(
            (FIRST + uniform_weights((3, size, size, PLANE_CHANNELS), SPREAD, seed, f"planes.{size}")) / RATE
            for size in nodes
        )

    @property
    def operations(self) -> int:
        """The multiplications and additions of one point: four corners on each of three planes, and their product."""
        return PLANE_CHANNELS * len(self.scales) * (3 * 2 * 4 + 2)

    def forward(self, x: Float[Tensor, "points 3"]) -> Float[Tensor, "points features"]:
        multiply = Multiplied.apply if compiles_for(x) else multiplied
        return RATE**3 * multiply(x, *self.scales)


def planes(spec: FieldSpec, nodes: tuple[int, ...]) -> FeatureField:
    return FeatureField(spec, Planes(nodes, spec.seed), PLANE_CHANNELS * len(nodes))


def multiplied(
    x: Float[Tensor, "points 3"], *scales: Float[Tensor, "3 _ _ channels"]
) -> Float[Tensor, "points features"]:
    """Compute `baselines.grids.interpolation.Multiplied` from operations of torch, differentiable by autograd."""
    at = torch.stack([x[:, [1, 0]], x[:, [2, 0]], x[:, [2, 1]]]).unsqueeze(2)
    features = []
    for scale in scales:
        channels = scale.permute(0, 3, 1, 2)
        sampled = grid_sample(channels, at, align_corners=True, padding_mode="border")[..., 0]
        features.append(sampled.prod(dim=0))
    return torch.cat(features).t()
