"""Three axis-aligned planes of features at several resolutions, multiplied: the hybrid K-Planes (arXiv 2301.10241)."""

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import grid_sample

from baselines.contract import FieldSpec, uniform_weights
from baselines.grids.feature_field import FeatureField, compiles_for
from baselines.grids.interpolation import PLANE_CHANNELS, Multiplied
from baselines.methods.explicit import PlaneSettings


class Planes(nn.Module):
    """An encoder of points −1 … 1: the product of the features on three planes, at each resolution."""

    def __init__(self, own: PlaneSettings, seed: int | str) -> None:
        super().__init__()
        self.rate = own.rate
        self.scales = nn.ParameterList(
            (own.first + uniform_weights((3, size, size, PLANE_CHANNELS), own.spread, seed, f"planes.{size}"))
            / own.rate
            for size in own.nodes
        )

    @property
    def operations(self) -> int:
        """Return the multiplications and additions per point: four corners on each of three planes, and the product."""
        return PLANE_CHANNELS * len(self.scales) * (3 * 2 * 4 + 2)

    def forward(self, x: Float[Tensor, "points 3"]) -> Float[Tensor, "points features"]:
        multiply = Multiplied.apply if compiles_for(x) else multiplied
        return self.rate**3 * multiply(x, *self.scales)


def planes(spec: FieldSpec) -> FeatureField:
    return FeatureField(spec, Planes(spec.own, spec.seed), PLANE_CHANNELS * len(spec.own.nodes))


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
