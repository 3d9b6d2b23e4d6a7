"""Which points of a ray are evaluated: the settings of sampling, and the bins that the occupancy grid leaves."""

from dataclasses import dataclass
from typing import NamedTuple

from jaxtyping import Bool, Float
from torch import Tensor

from baselines.contract import RadianceField, Rays
from baselines.numerics.quadrature import Rule
from baselines.numerics.sampling import Bins, Draws, Edges, uniform
from baselines.occupancy import OccupancyGrid


@dataclass(frozen=True)
class Sampling:
    bins: int
    fine_bins: int = 0
    """The number of further fenceposts by importance, used with a second (fine) field."""
    quadrature: str = "midpoint"
    clip_to_box: bool = True
    """Whether rays are cut to the box; listing-4 quadrature needs its last point at `far`."""
    early_stop: bool = False
    """Whether a ray without gradients stops where its transmittance is below `OPAQUE`, if density allows it."""
    hidden: bool = False
    """Whether training skips points that the occupancy grid hides (`OccupancyGrid.hidden`), if density allows it."""
    exploration: float = 0.0
    """The share of unoccupied points that training evaluates nevertheless."""
    fixed: bool = False
    """Whether all shapes depend only on the number of rays, and the host reads nothing (`march_fixed`)."""
    capacity: float = 1.0
    """The share of the points of a fixed shape that can be evaluated; what does not fit is counted as dropped."""


class Placed(NamedTuple):
    """The points of rays: what a march begins with."""

    t: Float[Tensor, "rays points"]
    t_edges: Edges
    x: Float[Tensor, "rays points 3"]
    lengths: Bins
    keep: Bool[Tensor, "rays bins"]
    """The bins that have a length and are not known to be empty or, in training, hidden."""


def placed(
    field: RadianceField,
    rays: Rays,
    t_edges: Edges,
    rule: Rule,
    sampling: Sampling,
    grid: OccupancyGrid | None,
    draws: Draws | None,
) -> Placed:
    """Return points in the bins, random in training (`draws`), and the bins to evaluate."""
    t, t_edges = rule.place(t_edges, draws)
    x = rays.origins.unsqueeze(1) + t.unsqueeze(-1) * rays.directions.unsqueeze(1)
    lengths = rule.lengths(t, t_edges)
    keep = lengths > 0
    if grid is not None:
        cell = grid.cell(x)
        occupied = grid.occupied[cell]
        if draws is not None:
            if sampling.hidden and field.pointwise:  # else skipping points would change the others
                occupied = occupied & ~grid.hidden(cell, lengths)
            u = uniform(cell.shape, draws, lengths)
            occupied = occupied | (grid.within[cell] & (u < sampling.exploration))
        keep = keep & rule.bins_with(occupied)
    return Placed(t, t_edges, x, lengths, keep)
