"""The renderer on fields whose pictures are known, and with every quadrature rule: the occupancy grid, stopping
early, importance sampling.
"""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.contract import Box, RadianceField, Rays, Rendering
from baselines.marching.sampling_plan import Sampling
from baselines.numerics.quadrature import QUADRATURES
from baselines.occupancy import OccupancyGrid
from baselines.rendering import OPAQUE, render_rays
from tests.baselines.analytic import (
    ORANGE,
    AnalyticField,
    ball,
    chord,
    cube,
    gaussian,
    homogeneous,
    rays_at,
    smooth_ball,
    soft_shell,
)

BACKGROUND = torch.tensor([1.0, 1.0, 0.5], dtype=torch.float64)


def render(
    field: RadianceField,
    rays: Rays,
    bins: int,
    box: Box | None = None,
    fine: RadianceField | None = None,
    grid: OccupancyGrid | None = None,
    generator: torch.Generator | None = None,
    **sampling: object,
) -> Rendering:
    settings = replace(Sampling(bins=bins), **sampling)  # type: ignore[arg-type]
    background = BACKGROUND.to(rays.origins.dtype)
    return render_rays(field, fine, rays, box or cube(), settings, grid, background, generator)


def along_z() -> Rays:
    kind = torch.float64
    return Rays(torch.tensor([[0.0, 0.0, 4.0]], dtype=kind), torch.tensor([[0.0, 0.0, -1.0]], dtype=kind), 2.0, 6.0)


def over_background(opacity: Tensor) -> Tensor:
    orange = torch.tensor(ORANGE, dtype=opacity.dtype)
    return opacity.unsqueeze(-1) * orange + (1.0 - opacity).unsqueeze(-1) * BACKGROUND.to(opacity.dtype)


SOUND = [name for name, rule in QUADRATURES.items() if not rule.of_the_paper]
every_sound_rule = pytest.mark.parametrize("rule", SOUND)


def test_depth_of_an_opaque_ball_is_its_surface() -> None:
    rays, bins = rays_at(0.3, 200), 256
    rendering = render(AnalyticField(ball(1e4, 0.8)), rays, bins)
    closest = -(rays.origins * rays.directions).sum(-1)
    hit = chord(rays, 0.8) > 0.1
    surface = closest - 0.5 * chord(rays, 0.8)
    assert float((rendering.depth - surface)[hit].abs().max()) <= math.sqrt(12.0) / bins
    assert torch.equal(rendering.depth[chord(rays, 0.8) == 0], torch.full((int((chord(rays, 0.8) == 0).sum()),), 6.0))


def test_cutting_rays_to_the_box_changes_nothing_for_a_field_that_is_zero_outside() -> None:
    rays = rays_at(0.5, 100)
    field = AnalyticField(smooth_ball(4.0, 0.9))
    clipped = render(field, rays, 1024)
    whole = render(field, rays, 1024, clip_to_box=False)
    torch.testing.assert_close(clipped.colour, whole.colour, rtol=0.0, atol=2e-5)
    torch.testing.assert_close(clipped.opacity, whole.opacity, rtol=0.0, atol=2e-5)
    hit = whole.opacity > 1e-3
    torch.testing.assert_close(clipped.depth[hit], whole.depth[hit], rtol=0.0, atol=2e-4)


@pytest.mark.parametrize("with_fine", [False, True])
@pytest.mark.parametrize("random", [False, True])
def test_rays_that_miss_the_box_are_background_without_any_evaluation(with_fine: bool, random: bool) -> None:
    rays = rays_at(0.2, 12)
    rays = Rays(rays.origins, -rays.directions, rays.near, rays.far)
    field = AnalyticField(homogeneous(5.0))
    generator = torch.Generator().manual_seed(0) if random else None
    fine = field if with_fine else None
    rendering = render(field, rays, 8, fine=fine, fine_bins=8 * with_fine, generator=generator)
    assert torch.equal(rendering.colour, BACKGROUND.expand(12, 3))
    assert torch.equal(rendering.opacity, torch.zeros(12, dtype=torch.float64))
    assert torch.equal(rendering.depth, torch.full((12,), 6.0, dtype=torch.float64))
    assert rendering.network_evaluations == 0
    assert field.points == 0


def test_no_rays() -> None:
    rays = rays_at(0.3, 0)
    rendering = render(AnalyticField(homogeneous(1.0)), rays, 8, fine=AnalyticField(homogeneous(1.0)), fine_bins=8)
    assert rendering.colour.shape == (0, 3)
    assert rendering.opacity.shape == rendering.depth.shape == (0,)


@every_sound_rule
def test_evaluations_of_both_passes_are_counted_and_fog_is_exact(rule: str) -> None:
    coarse, fine = AnalyticField(homogeneous(1.0)), AnalyticField(homogeneous(1.0))
    rendering = render(coarse, along_z(), 16, fine=fine, fine_bins=20, quadrature=rule)
    stride, closed = QUADRATURES[rule].stride, QUADRATURES[rule].closed
    assert coarse.points == 16 * stride + closed
    assert fine.points == 36 * stride + closed, "17 + 20 fenceposts"
    assert rendering.network_evaluations == coarse.points + fine.points
    opacity = torch.tensor([-math.expm1(-2.0)], dtype=torch.float64)
    torch.testing.assert_close(rendering.opacity, opacity, rtol=1e-12, atol=0.0)
    torch.testing.assert_close(rendering.colour, over_background(opacity), rtol=1e-12, atol=0.0)


def test_the_distribution_of_the_coarse_pass_gets_no_gradient() -> None:
    weight = torch.ones((), dtype=torch.float64, requires_grad=True)
    coarse = AnalyticField(lambda x: weight * gaussian(5.0, 0.4)(x))
    rendering = render(coarse, rays_at(0.2, 5), 16, fine=AnalyticField(gaussian(5.0, 0.4)), fine_bins=16)
    assert not rendering.colour.requires_grad
    assert rendering.coarse_colour is not None
    rendering.coarse_colour.sum().backward()
    assert weight.grad is not None
    assert weight.grad.abs() > 0


def test_listing4_has_no_background_and_needs_the_whole_ray() -> None:
    rays = rays_at(0.3, 30)
    empty = render(AnalyticField(homogeneous(0.0)), rays, 16, clip_to_box=False, quadrature="listing4")
    assert torch.equal(empty.colour, torch.zeros(30, 3, dtype=torch.float64)), "black, not the background"
    hazy = render(AnalyticField(homogeneous(1e-6)), rays, 16, clip_to_box=False, quadrature="listing4")
    torch.testing.assert_close(hazy.opacity, torch.ones(30, dtype=torch.float64), rtol=0.0, atol=1e-6)


# every rule


@every_sound_rule
@pytest.mark.parametrize("random", [False, True])
@pytest.mark.parametrize("reach", [0.71, 0.45])
def test_what_the_grid_leaves_out_leaves_no_dark_fringe(rule: str, random: bool, reach: float) -> None:
    """A bin with one point in an occupied cell is evaluated completely, all others have no length: every weight has an
    evaluated colour. At a reach of 0.45 the grid is wrong and cuts geometry off.
    """
    field, rays = AnalyticField(ball(3.0, 0.6)), rays_at(0.3, 60)
    grid = OccupancyGrid(16, cube(), 0.01)
    grid.density = torch.zeros_like(grid.density)
    centre = (torch.arange(16) + 0.5) / 8.0 - 1.0
    x = torch.stack(torch.meshgrid(centre, centre, centre, indexing="ij"), dim=-1)
    grid.occupied = (x.norm(dim=-1) < reach).flatten()
    generator = torch.Generator().manual_seed(1) if random else None
    sparse = render(field, rays, 24, quadrature=rule, grid=grid, generator=generator)
    # orange over the background in every ray: nothing darker than the one mixed with the other
    torch.testing.assert_close(sparse.colour, over_background(sparse.opacity), rtol=0.0, atol=1e-12)
    if not random and reach > 0.6:
        whole = render(field, rays, 24, quadrature=rule)
        torch.testing.assert_close(sparse.colour, whole.colour, rtol=0.0, atol=1e-12)
        assert sparse.network_evaluations < 0.8 * whole.network_evaluations


@every_sound_rule
@pytest.mark.parametrize("bins", [1, 3, 64])
@pytest.mark.parametrize("density", [0.1, 3.0, 100.0, 1e4])
@torch.no_grad()
def test_stopping_early_changes_less_than_its_bound(rule: str, bins: int, density: float) -> None:
    rays = rays_at(0.3, 40)
    fields = [AnalyticField(smooth_ball(density, 0.9)) for _ in range(2)]
    stopped, whole = (
        render(field, rays, bins, quadrature=rule, early_stop=stop)
        for field, stop in zip(fields, (True, False), strict=True)
    )
    assert (stopped.colour - whole.colour).abs().max() <= OPAQUE
    assert (stopped.opacity - whole.opacity).abs().max() <= OPAQUE
    assert (stopped.depth - whole.depth).abs().max() <= 4.0 * OPAQUE / (1.0 - OPAQUE)
    assert stopped.network_evaluations == fields[0].points <= fields[1].points
    if density == 1e4 and bins == 64:
        assert fields[0].points < 0.8 * fields[1].points


@pytest.mark.parametrize("random", [False, True])
def test_importance_samples_help(random: bool) -> None:
    """Case Q5 tries every rule."""
    rays, field = rays_at(0.2, 100), AnalyticField(soft_shell(10.0, 0.6, 0.03))
    truth = render(field, rays, 4096)
    generator = torch.Generator().manual_seed(4) if random else None
    both = render(field, rays, 32, fine=field, fine_bins=128, generator=generator)
    coarse = render(field, rays, 32, generator=torch.Generator().manual_seed(4) if random else None)
    torch.testing.assert_close(both.coarse_colour, coarse.colour)

    def error(of: Rendering, what: str) -> float:
        return float((getattr(of, what) - getattr(truth, what)).square().mean().sqrt())

    for what in ("colour", "depth"):
        assert error(both, what) < 0.5 * error(coarse, what)


@pytest.mark.parametrize("pointwise", [True, False])
def test_nothing_stops_with_gradients_or_where_density_depends_on_the_chunk(pointwise: bool) -> None:
    """Listing 2 takes its mean over the points of the chunk: leaving some out would change the others."""
    field = AnalyticField(homogeneous(1e4))
    field.pointwise = pointwise
    with torch.set_grad_enabled(pointwise):
        render(field, along_z(), 64, early_stop=True)
    assert field.points == 64
