"""Marching along rays with fixed shapes, in which host and device never wait for each other.

A graph of the device can replay it (`harness.training.turns`). What `baselines.rendering` leaves out is masked here:
all points are evaluated, or those of the chosen bins are packed into a capacity. Nothing is checked on the host;
invalid densities and points beyond the capacity are counted on the device (`baselines.contract.Counts`).
"""

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from baselines.contract import Counts, Rays, Rendering, Samples
from baselines.field import NetworkField
from baselines.marching.sampling_plan import Sampling, placed
from baselines.numerics.compositing import expected_depth
from baselines.numerics.quadrature import QUADRATURES
from baselines.numerics.sampling import Bins, Draws, Edges
from baselines.occupancy import OccupancyGrid


def march_fixed(
    field: NetworkField,
    rays: Rays,
    t_edges: Edges,
    sampling: Sampling,
    grid: OccupancyGrid | None,
    background: Float[Tensor, " 3"],
    draws: Draws | None,
) -> tuple[Rendering, Edges, Bins]:
    """March once along all rays; the results are those of the march in `baselines.rendering`, to rounding."""
    rule = QUADRATURES[sampling.quadrature]
    t, t_edges, x, lengths, keep = placed(field, rays, t_edges, rule, sampling, grid, draws)
    points = rule.points_of(keep)
    if rule.closed:
        lengths = lengths * keep
    capacity = math.ceil(sampling.capacity * points.numel())
    if capacity < points.numel():
        view = field.encode_directions(rays.directions)
        sigma, colour = _packed(field, x, view, points, capacity)
    else:
        sigma, colour = field.density_and_colour_of_rays(x, rays.directions, points)
    invalid = points & ~((sigma >= 0) & (sigma < torch.inf))
    sigma = torch.where(points, sigma, 0.0)
    w, T_end = rule.weights(sigma, lengths)
    rendering = Rendering(
        colour=(w.unsqueeze(-1) * colour).sum(dim=1) + T_end.unsqueeze(-1) * background,
        opacity=w.sum(dim=-1),
        depth=expected_depth(w, t, rays.far),
        network_evaluations=capacity,
        counts=Counts(invalid.sum(), points.float().mean()),
        samples=Samples(sigma.detach(), w.detach()),
    )
    return rendering, t_edges, rule.bin_weights(w, sigma, lengths)


def _packed(
    field: NetworkField,
    x: Float[Tensor, "rays points 3"],
    view: Float[Tensor, "rays features"],
    points: Bool[Tensor, "rays points"],
    capacity: int,
) -> tuple[Float[Tensor, "rays points"], Float[Tensor, "rays points 3"]]:
    """Evaluate the first `capacity` of the chosen points; the others have density 0 and are black."""
    count, of_a_ray = points.numel(), points.shape[1]
    chosen = points.reshape(-1)
    place = torch.cumsum(chosen, dim=0)
    # the row behind the last takes what is not chosen or does not fit
    slot = torch.where(chosen & (place <= capacity), place - 1, capacity)
    index = torch.full((capacity + 1,), count, device=x.device).scatter(0, slot, torch.arange(count, device=x.device))
    index = index[:capacity]
    counted = index < count
    taken = index.clamp(max=count - 1)
    sigma, colour = field.density_and_colour(x.reshape(-1, 3)[taken], view, taken // of_a_ray, counted)

    def spread(values: Tensor) -> Tensor:
        everything = values.new_zeros((count + 1, *values.shape[1:])).index_copy(0, index, values)
        return everything[:count].view(*points.shape, *values.shape[1:])

    return spread(sigma), spread(colour)
