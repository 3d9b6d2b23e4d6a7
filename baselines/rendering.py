"""Rays through a radiance field: the one renderer of every method.

    entry and exit of the scene's box → bins → points → (occupied ones only) field → quadrature → compositing

A point that is left out has density 0, so one quadrature serves dense and sparse sampling alike.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Box, RadianceField, Rays, Rendering
from baselines.numerics.bounds import ray_box
from baselines.numerics.compositing import composite, expected_depth
from baselines.numerics.quadrature import QUADRATURES
from baselines.numerics.sampling import inverse_cdf_edges, points_in_bins, uniform_edges
from baselines.occupancy import OccupancyGrid


@dataclass(frozen=True)
class Sampling:
    """How many points a ray gets, and where."""

    bins: int
    fine_bins: int = 0
    """Further fenceposts by importance, where there is a second (fine) field."""
    quadrature: str = "midpoint"
    clip_to_box: bool = True
    """Without it rays run from near to far; the listing-4 quadrature needs its last point to lie at `far`."""
    exploration: float = 0.0
    """Share of unoccupied points that are evaluated all the same (training alone)."""


def render_rays(
    coarse: RadianceField,
    fine: RadianceField | None,
    rays: Rays,
    box: Box,
    sampling: Sampling,
    grid: OccupancyGrid | None,
    background: Float[Tensor, " 3"],
    generator: torch.Generator | None,
) -> Rendering:
    """Colours of `rays`. With a generator points are random inside their bins (training), without one midpoints.

    The result does not depend on which rays share the call, unless a field's density does (Listing 2, Eq. 4).
    """
    if sampling.clip_to_box:
        entry, leave, _ = ray_box(rays.origins, rays.directions, box.lower, box.upper, rays.near, rays.far)
    else:
        entry = torch.full_like(rays.origins[:, 0], rays.near)
        leave = torch.full_like(entry, rays.far)
    t_edges = uniform_edges(entry, leave, sampling.bins)
    first = _march(coarse, rays, t_edges, sampling, grid, background, generator)
    if fine is None:
        return first.rendering
    drawn = inverse_cdf_edges(t_edges, first.w.detach(), sampling.fine_bins, generator)
    fine_edges, _ = torch.sort(torch.cat([t_edges, drawn], dim=-1), dim=-1)
    second = _march(fine, rays, fine_edges, sampling, grid, background, generator).rendering
    return Rendering(
        colour=second.colour,
        opacity=second.opacity,
        depth=second.depth,
        network_evaluations=first.rendering.network_evaluations + second.network_evaluations,
        coarse_colour=first.rendering.colour,
    )


@dataclass(frozen=True)
class _March:
    rendering: Rendering
    w: Float[Tensor, "rays bins"]


def _march(
    field: RadianceField,
    rays: Rays,
    t_edges: Float[Tensor, "rays edges"],
    sampling: Sampling,
    grid: OccupancyGrid | None,
    background: Float[Tensor, " 3"],
    generator: torch.Generator | None,
) -> _March:
    t = points_in_bins(t_edges, generator)
    x = rays.origins.unsqueeze(1) + t.unsqueeze(-1) * rays.directions.unsqueeze(1)
    keep = t_edges[:, 1:] > t_edges[:, :-1]
    if grid is not None:
        occupied = grid.at(x)
        if generator is not None and sampling.exploration > 0.0:
            lot = torch.rand(t.shape, generator=generator, device=generator.device).to(t.device)
            occupied = occupied | (lot < sampling.exploration)
        keep = keep & occupied
    ray, bin_ = torch.nonzero(keep, as_tuple=True)
    sigma_kept, colour_kept = field.density_and_colour(x[ray, bin_], field.encode_directions(rays.directions), ray)
    sigma = torch.zeros_like(t).index_put((ray, bin_), sigma_kept)
    w, T_end = QUADRATURES[sampling.quadrature](sigma, t, t_edges)
    rendering = Rendering(
        colour=composite(w[ray, bin_], ray, colour_kept, T_end, background),
        opacity=w.sum(dim=-1),
        depth=expected_depth(w, t, rays.far),
        network_evaluations=len(ray),
    )
    return _March(rendering, w)
