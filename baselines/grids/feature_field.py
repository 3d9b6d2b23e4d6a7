"""Learnt features of points and the network that maps them to density and colour (instant-ngp, arXiv 2201.05989)."""

import math
from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn.functional import relu, softplus

from baselines.contract import (
    Densities,
    FieldSpec,
    Points,
    RayOf,
    Views,
    counts_by_component,
    glorot,
)
from baselines.methods.explicit import FeatureSettings
from baselines.numerics.amplifier import softplus_shift
from baselines.numerics.encoding import encode, feature_count


class Decoder(nn.Module):
    """Features → one hidden layer → density, and with the view direction another hidden layer → colour."""

    def __init__(self, features: int, directions: int, width: int, seed: int | str) -> None:
        super().__init__()
        self.density = nn.Linear(features, width)
        self.density_head = nn.Linear(width, 1)
        self.colour = nn.Linear(width + directions, width)
        self.colour_head = nn.Linear(width, 3)
        glorot(self.named_parameters(), seed)

    def forward(
        self, features: Float[Tensor, "points channels"], view: Views | None = None, ray: RayOf | None = None
    ) -> tuple[Float[Tensor, " points"], Float[Tensor, "points 3"] | None]:
        """Return raw density and, with a view, colour logits, both float32."""
        hidden = relu(self.density(features))
        raw = self.density_head(hidden)[:, 0]
        if view is None or ray is None:
            return raw, None
        return raw, self.colour_head(relu(self.colour(torch.cat([hidden, view[ray]], dim=-1))))


class FeatureField(nn.Module):
    pointwise = True
    density_limit = math.inf

    def __init__(self, spec: FieldSpec, encoder: nn.Module, features: int) -> None:
        """Take an encoder that maps points −1 … 1 to `features` numbers each; its parameters are learnt."""
        super().__init__()
        self.box, self.view_dependent, self.own = spec.box, spec.view_dependent, cast("FeatureSettings", spec.own)
        self.density_unit = self.own.density_scale / spec.box.half_extent
        self.shift = softplus_shift(self.own.start / self.own.density_scale)
        self.encoder = encoder
        directions = feature_count(3, self.own.direction_bands) if self.view_dependent else 0
        self.decoder = Decoder(features, directions, self.own.width, spec.seed)

    def parameter_counts(self) -> dict[str, int]:
        return counts_by_component(self)

    def encode_directions(self, d: Float[Tensor, "rays 3"]) -> Views:
        return encode(d, 2.0, self.own.direction_bands) if self.view_dependent else d[:, :0]

    def density(self, x: Points) -> Densities:
        return self._sigma(self.decoder(self._features(x))[0])

    def density_before_and_after(self, x: Points) -> tuple[Densities, Densities]:
        sigma = self.density(x)
        return sigma, sigma

    def density_and_colour(self, x: Points, view: Views, ray: RayOf) -> tuple[Densities, Float[Tensor, "points 3"]]:
        raw, logits = self.decoder(self._features(x), view, ray)
        return self._sigma(raw), torch.sigmoid(logits)

    def _features(self, x: Points) -> Float[Tensor, "points features"]:
        features: Tensor = self.encoder(self.box.normalised(x))
        return features

    def _sigma(self, raw: Float[Tensor, " points"]) -> Densities:
        return softplus(raw + self.shift) * self.density_unit


def compiles_for(x: Float[Tensor, "points 3"]) -> bool:
    """Return whether the compiled kernels can take these points: on the processor, float32, without a gradient."""
    return x.device.type == "cpu" and x.dtype == torch.float32 and not x.requires_grad
