"""The non-empty cells of the scene's box: empty ones need no network evaluation.

All methods have the same grid, each measured on the method's density. It starts as the hull of the box, or as all cells
without a hull. No cell of the hull is skipped before it has been measured, and a ray always keeps some random samples
in skipped cells (`baselines.rendering`), so that a cell that was skipped by mistake can come back.
"""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import adaptive_max_pool3d

from baselines.contract import Box, RadianceField

HIDDEN = 12.0
"""The optical depth, as the grid measures it, behind which training evaluates nothing. At 3, densities that a ray only
grazes hide what lies behind them, and 7 dB are lost; at 7, 0.2 dB; at 12 no loss was seen.
"""
MEASURED_AT_ONCE = 1 << 17
"""The points of a refresh that are in memory at a time: complete blocks, so that with one thread no bit depends on it.
"""
DECAY = 0.6
"""The factor of a cell's remembered density per refresh, so that geometry that vanished is forgotten."""


class OccupancyGrid:
    """The largest recent density of each cell, `density` [cells³], which is infinite before the first measurement, and
    the mask of the cells that are evaluated, `occupied` [cells³].
    """

    def __init__(self, cells: int, box: Box, opacity_threshold: float) -> None:
        self.cells = cells
        self.box = box
        self.opacity_threshold = opacity_threshold
        if box.hull is None or not bool(box.hull.any()):
            within = torch.ones(cells**3, dtype=torch.bool)
        else:  # the cells that overlap one of the hull
            within = adaptive_max_pool3d(box.hull.float()[None], cells).bool().reshape(-1)
        self.within = within.to(box.lower.device)
        """The cells that are not known to be empty [cells³]."""
        self.occupied = self.within.clone()
        self.density = torch.where(self.within, torch.inf, 0.0)
        self.emptied = False
        """Whether the last refresh found no occupied cell; the mask is then the hull again."""

    def hidden(self, cell: Int[Tensor, "rays bins"], lengths: Float[Tensor, "rays bins"]) -> Bool[Tensor, "rays bins"]:
        """Return whether a bin lies behind so much remembered density that no light comes from it.

        The grid remembers the largest densities, and a ray meets less at the border of a cell. So the threshold of the
        optical depth is `HIDDEN`, far beyond what a picture can show.
        """
        known = self.density[cell]
        depth = torch.where(self.occupied[cell] & torch.isfinite(known), known, 0.0) * lengths
        return torch.cumsum(depth, dim=-1) - depth > HIDDEN

    def cell(self, x: Float[Tensor, "*points 3"]) -> Int[Tensor, "*points"]:
        """Return the number of the cell around each point; points outside the box belong to its nearest cell."""
        index = (self.box.to_unit(x) * self.cells).long().clamp_(0, self.cells - 1)
        return (index[..., 0] * self.cells + index[..., 1]) * self.cells + index[..., 2]

    @torch.no_grad()
    def refresh(self, field: RadianceField, share: float, generator: torch.Generator) -> int:
        """Measure a random `share` of the cells not known to be empty, each at one random point; return how many."""
        chosen = torch.nonzero(self.within)[:, 0].cpu()
        if share < 1.0:
            chosen = chosen[torch.randperm(len(chosen), generator=generator)[: max(1, int(share * len(chosen)))]]
        corner = torch.stack([chosen // self.cells**2, chosen // self.cells % self.cells, chosen % self.cells], dim=-1)
        jitter = torch.rand(corner.shape, generator=generator)
        x = self.box.from_unit(((corner + jitter) / self.cells).to(self.density.device))
        chosen = chosen.to(self.density.device)
        remembered = self.density[chosen]
        faded = torch.where(torch.isinf(remembered), 0.0, remembered * DECAY)
        measured = torch.cat([field.density(part) for part in x.split(MEASURED_AT_ONCE)])
        self.density[chosen] = torch.maximum(faded, measured)
        self._threshold()
        return len(chosen)

    def _threshold(self) -> None:
        """Mark the cells in which a ray loses more than `opacity_threshold` of what it loses in the densest cell.

        The threshold is relative because methods differ in the density that they can reach: one method's thin fog is
        another's maximum. It is the same rule for all methods, and cautious while nothing is dense yet.
        """
        thickness = float((self.box.upper - self.box.lower).max()) / self.cells
        opacity = -torch.expm1(-self.density * thickness)
        seen = self.within & (opacity > self.opacity_threshold * opacity[self.within].max())
        self.emptied = not bool(seen.any())
        self.occupied.copy_(self.within if self.emptied else seen)  # in place, as a captured step reads it there

    def occupied_share(self) -> float:
        return float(self.occupied.float().mean())
