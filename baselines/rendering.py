"""Rays through a radiance field: the renderer of every method.

    entry and exit of the scene's box → bins → points → (occupied ones only) field → quadrature → compositing

A bin that is not evaluated has optical depth 0, so that one quadrature serves dense and sparse sampling.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Box, RadianceField, Rays, Rendering, Samples
from baselines.marching.fixed_shapes import march_fixed
from baselines.marching.sampling_plan import Sampling, placed
from baselines.numerics.bounds import ray_box
from baselines.numerics.checks import BadDensity, require_density, require_interval
from baselines.numerics.compositing import composite, expected_depth
from baselines.numerics.quadrature import QUADRATURES
from baselines.numerics.sampling import Bins, Draws, Edges, inverse_cdf_edges, uniform_edges
from baselines.occupancy import OccupancyGrid

OPAQUE = 1e-4
"""The transmittance below which nothing is evaluated. It changes a colour by less than 1e-4, 1/39 of an 8-bit step."""
SEGMENTS = 4
"""The number of parts, front to back, in which a ray that may stop early is evaluated."""


def render_rays(
    coarse: RadianceField,
    fine: RadianceField | None,
    rays: Rays,
    box: Box,
    sampling: Sampling,
    grid: OccupancyGrid | None,
    background: Float[Tensor, " 3"],
    draws: Draws | None,
) -> Rendering:
    """Render `rays`. Points are random inside their bins with `draws` (training), else midpoints. The samples of
    the result are those of the rays that meet the box, with fixed shapes those of all rays.

    The result does not depend on which rays share the chunk, unless a field's density does (Listing 2, Eq. 4).
    Raises `BadInterval` unless near <= far, both finite, and `BadDensity` naming ray and sample where the field returns
    a density that is negative or not finite.
    """
    require_interval(rays.near, rays.far)
    march: Callable[..., tuple[Rendering, Edges, Bins]] = partial(
        march_fixed if sampling.fixed else _march, sampling=sampling, grid=grid, background=background, draws=draws
    )

    def coarse_and_fine(rays: Rays, entry: Tensor, leave: Tensor) -> Rendering:
        first, edges, w = march(coarse, rays, uniform_edges(entry, leave, sampling.bins))
        if fine is None:
            return first
        drawn = inverse_cdf_edges(edges, w.detach(), sampling.fine_bins, draws)
        fine_edges, _ = torch.sort(torch.cat([edges, drawn], dim=-1), dim=-1)
        second, _, _ = march(fine, rays, fine_edges)
        evaluations = first.network_evaluations + second.network_evaluations
        counts = None if first.counts is None or second.counts is None else first.counts.joined(second.counts)
        return replace(second, network_evaluations=evaluations, coarse_colour=first.colour, counts=counts)

    if not sampling.clip_to_box:
        entry = torch.full_like(rays.origins[:, 0], rays.near)
        return coarse_and_fine(rays, entry, torch.full_like(entry, rays.far))
    entry, leave, hit = ray_box(rays.origins, rays.directions, box.lower, box.upper, rays.near, rays.far)
    if sampling.fixed:  # rays that miss have bins of length 0, and show the background
        return coarse_and_fine(rays, entry, leave)
    inside = torch.nonzero(hit)[:, 0]
    try:
        seen = coarse_and_fine(rays.chosen(inside), entry[inside], leave[inside])
    except BadDensity as error:
        raise error.among(inside) from None

    def over_background(values: Tensor) -> Tensor:
        return background.expand(len(rays), 3).index_put((inside,), values)

    return Rendering(
        colour=over_background(seen.colour),
        opacity=seen.opacity.new_zeros(len(rays)).index_put((inside,), seen.opacity),
        depth=seen.depth.new_full((len(rays),), rays.far).index_put((inside,), seen.depth),
        network_evaluations=seen.network_evaluations,
        coarse_colour=None if seen.coarse_colour is None else over_background(seen.coarse_colour),
        samples=seen.samples,
    )


def _march(
    field: RadianceField,
    rays: Rays,
    t_edges: Edges,
    sampling: Sampling,
    grid: OccupancyGrid | None,
    background: Float[Tensor, " 3"],
    draws: Draws | None,
) -> tuple[Rendering, Edges, Bins]:
    """March once along all rays. Return the rendering, the fenceposts of the bins, and the weight of each bin.

    Where bins share points, a bin is evaluated completely or has length 0: every point with a weight has a colour.
    """
    rule = QUADRATURES[sampling.quadrature]
    t, t_edges, x, lengths, keep = placed(field, rays, t_edges, rule, sampling, grid, draws)
    view = field.encode_directions(rays.directions)
    may_stop = sampling.early_stop and field.pointwise and not torch.is_grad_enabled()
    sigma = torch.zeros_like(t)
    evaluated = []
    shared = torch.zeros_like(keep[:, 0])  # points on the border of two segments that were evaluated already
    segments = SEGMENTS if may_stop else 1
    for first, last in pairwise(sorted({round(keep.shape[1] * i / segments) for i in range(segments + 1)})):
        chosen = keep[:, first:last]
        if first > 0:
            before = rule.optical_depth(sigma[:, : first * rule.stride + rule.closed], lengths[:, :first]).sum(dim=-1)
            chosen = chosen & (before < -math.log(OPAQUE)).unsqueeze(-1)
        points = rule.points_of(chosen)
        if rule.closed:
            lengths[:, first:last] *= chosen
            points[:, 0] &= ~shared
            shared = points[:, -1]
        ray, point = torch.nonzero(points, as_tuple=True)
        point = point + first * rule.stride
        sigma_kept, colour_kept = field.density_and_colour(x[ray, point], view, ray)
        sigma = sigma.index_put((ray, point), sigma_kept)
        evaluated.append((ray, point, colour_kept))
    ray, point, colour = (torch.cat(parts) for parts in zip(*evaluated, strict=True))
    require_density(sigma)
    w, T_end = rule.weights(sigma, lengths)
    rendering = Rendering(
        colour=composite(w[ray, point], ray, colour, T_end, background),
        opacity=w.sum(dim=-1),
        depth=expected_depth(w, t, rays.far),
        network_evaluations=len(ray),
        samples=Samples(sigma.detach(), w.detach()),
    )
    return rendering, t_edges, rule.bin_weights(w, sigma, lengths)
