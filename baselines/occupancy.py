"""The non-empty cells of the scene's box: empty ones need no network evaluation.

All methods have the same grid, each of its own density. It starts full; nothing is left out before it has been
measured, and a ray always keeps some random samples outside of it (`baselines.rendering`), so what was deleted by
mistake can come back.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from baselines.contract import Box, RadianceField

DECAY = 0.6
"""The decay of a cell's remembered density per refresh, so that geometry that vanished is forgotten."""


class OccupancyGrid:
    """`density` [cells³] remembers the largest density lately seen in each cell, infinite where none was measured yet;
    `occupied` [cells³] is its mask.
    """

    def __init__(self, cells: int, box: Box, opacity_threshold: float) -> None:
        self.cells = cells
        self.box = box
        self.opacity_threshold = opacity_threshold
        self.density = torch.full((cells**3,), torch.inf, device=box.lower.device)
        self.occupied = torch.ones(cells**3, dtype=torch.bool, device=box.lower.device)
        self.emptied = False
        """Return whether the last refresh found no occupied cell; the mask is then full again."""

    def at(self, x: Float[Tensor, "*points 3"]) -> Bool[Tensor, "*points"]:
        """Return whether the cell around each point is occupied; points outside the box belong to its nearest cell."""
        index = (self.box.to_unit(x) * self.cells).long().clamp_(0, self.cells - 1)
        flat = (index[..., 0] * self.cells + index[..., 1]) * self.cells + index[..., 2]
        return self.occupied[flat]

    @torch.no_grad()
    def refresh(self, field: RadianceField, share: float, generator: torch.Generator) -> int:
        """Measure a random `share` of the cells, each at one random point; returns the number of evaluations."""
        count = self.cells**3
        if share >= 1.0:
            chosen = torch.arange(count)
        else:
            chosen = torch.randperm(count, generator=generator)[: max(1, int(share * count))]
        corner = torch.stack([chosen // self.cells**2, chosen // self.cells % self.cells, chosen % self.cells], dim=-1)
        jitter = torch.rand(corner.shape, generator=generator)
        x = self.box.from_unit(((corner + jitter) / self.cells).to(self.density.device))
        chosen = chosen.to(self.density.device)
        remembered = self.density[chosen]
        faded = torch.where(torch.isinf(remembered), 0.0, remembered * DECAY)
        self.density[chosen] = torch.maximum(faded, field.density(x))
        self._threshold()
        return len(chosen)

    def _threshold(self) -> None:
        """Mark the occupied cells: those in which a ray loses more than `opacity_threshold` of what it
        loses in the densest one.

        Relative, because methods differ in the density that they can reach: what is thin fog to one is all that
        another has. The threshold is the same rule for all methods, and cautious while nothing is dense yet.
        """
        thickness = float((self.box.upper - self.box.lower).max()) / self.cells
        opacity = -torch.expm1(-self.density * thickness)
        seen = opacity > self.opacity_threshold * opacity.max()
        self.emptied = not bool(seen.any())
        self.occupied = torch.ones_like(self.occupied) if self.emptied else seen

    def occupied_share(self) -> float:
        return float(self.occupied.float().mean())
