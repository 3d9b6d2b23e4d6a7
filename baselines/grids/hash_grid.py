"""Features in hash tables at many resolutions: instant-ngp (Müller et al. 2022, arXiv 2201.05989)."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from baselines.contract import FieldSpec, uniform_weights
from baselines.grids.feature_field import FeatureField, compiles_for
from baselines.grids.interpolation import PRIMES, TABLE_CHANNELS, Encoded
from baselines.methods.explicit import TableSettings


class HashGrid(nn.Module):
    """An encoder of points −1 … 1: the features of each level, interpolated between eight nodes."""

    def __init__(self, own: TableSettings, seed: int | str) -> None:
        super().__init__()
        self.rate, self.cells = own.rate, own.cells
        shapes = [(min((size + 1) ** 3, own.entries), TABLE_CHANNELS) for size in own.cells]
        self.tables = nn.ParameterList(
            uniform_weights(shape, own.spread, seed, f"table.{level}.{size}") / own.rate
            for level, (size, shape) in enumerate(zip(own.cells, shapes, strict=True))
        )

    @property
    def operations(self) -> int:
        """Return the multiplications and additions per point: eight corners of each level."""
        return TABLE_CHANNELS * len(self.tables) * 2 * 8

    def forward(self, x: Float[Tensor, "points 3"]) -> Float[Tensor, "points features"]:
        encode = Encoded.apply if compiles_for(x) else encoded
        return self.rate * encode(x, self.cells, *self.tables)


def hash_grid(spec: FieldSpec) -> FeatureField:
    return FeatureField(spec, HashGrid(spec.own, spec.seed), TABLE_CHANNELS * len(spec.own.cells))


def encoded(
    x: Float[Tensor, "points 3"], cells: tuple[int, ...], *tables: Float[Tensor, "_ channels"]
) -> Float[Tensor, "points features"]:
    """Compute `baselines.grids.interpolation.Encoded` from operations of torch, differentiable by autograd."""
    corners = torch.cartesian_prod(*[torch.arange(2, device=x.device)] * 3)
    features = []
    for size, table in zip(cells, tables, strict=True):
        at = ((x + 1.0) * 0.5 * size).clamp(0.0, size)
        low = at.long().clamp(max=size - 1)
        inside = (at - low)[:, None]
        nodes = low[:, None] + corners
        weight = torch.where(corners.bool(), inside, 1.0 - inside).prod(dim=-1)
        if (size + 1) ** 3 <= len(table):
            entry = (nodes[..., 0] * (size + 1) + nodes[..., 1]) * (size + 1) + nodes[..., 2]
        else:
            factors = torch.tensor(PRIMES, device=x.device)
            hashed = (nodes * factors) & 0xFFFFFFFF  # unsigned 32-bit multiplication
            entry = (hashed[..., 0] ^ hashed[..., 1] ^ hashed[..., 2]) % len(table)
        features.append((weight[..., None] * table[entry]).sum(dim=1))
    return torch.cat(features, dim=-1)
