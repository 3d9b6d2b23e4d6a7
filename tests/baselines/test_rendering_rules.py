"""The renderer with every quadrature rule: training, the occupancy grid, stopping early, importance sampling."""

from dataclasses import replace

import pytest
import torch

from baselines.catalog import CATALOG, Method
from baselines.contract import Rendering
from baselines.methods.nerf import NERF
from baselines.numerics.quadrature import QUADRATURES
from baselines.occupancy import OccupancyGrid
from baselines.rendering import OPAQUE
from harness.plan.schedule import Budget
from harness.plan.settings import GridSettings, TrainSettings
from harness.training.learner import Job
from harness.training.trainer import Trainer
from tests.baselines.analytic import AnalyticField, ball, cube, gaussian, homogeneous, rays_at, smooth_ball, soft_shell
from tests.baselines.small_fields import BOX, SMALL
from tests.baselines.test_rendering import SOUND, along_z, every_sound_rule, over_background, render


@every_sound_rule
def test_all_rules_see_the_same(rule: str) -> None:
    field, rays = AnalyticField(gaussian(5.0, 0.4)), rays_at(0.4, 40)
    ours, truth = render(field, rays, 400, quadrature=rule), render(field, rays, 4000)
    bar = 2e-3 if rule == "left" else 1e-4
    torch.testing.assert_close(ours.colour, truth.colour, rtol=0.0, atol=bar)
    hit = truth.opacity > 0.1
    torch.testing.assert_close(ours.depth[hit], truth.depth[hit], rtol=0.0, atol=10 * bar)


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


@pytest.mark.parametrize("rule", [name for name in SOUND if name != "left"])
@pytest.mark.parametrize("random", [False, True])
def test_importance_samples_help(rule: str, random: bool) -> None:
    """The rule of the left point is excluded: its samples fall behind the surface and leave the front coarse."""
    rays, field = rays_at(0.2, 100), AnalyticField(soft_shell(10.0, 0.6, 0.03))
    truth = render(field, rays, 4096)
    generator = torch.Generator().manual_seed(4) if random else None
    both = render(field, rays, 32, fine=field, fine_bins=128, quadrature=rule, generator=generator)
    coarse = render(field, rays, 32, quadrature=rule, generator=torch.Generator().manual_seed(4) if random else None)
    torch.testing.assert_close(both.coarse_colour, coarse.colour)

    def error(of: Rendering, what: str) -> float:
        return float((getattr(of, what) - getattr(truth, what)).square().mean().sqrt())

    for what in ("colour", "depth"):
        assert error(both, what) < 0.5 * error(coarse, what)


@pytest.mark.parametrize("rule", QUADRATURES)
def test_a_nerf_with_the_rule_renders_and_learns(rule: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CATALOG, "tried", Method(replace(NERF, quadrature=rule), "NeRF with another rule"))
    settings = TrainSettings(network=SMALL, bins=12, first_bins=12, fine_bins=4, learning_rate=2e-2)
    settings = replace(settings, grid=GridSettings(cells=0))
    learner = Trainer(Job("tried", BOX, settings, Budget(40, None), 0, torch.device("cpu")))
    rays = rays_at(0.4, 16, dtype=torch.float32)
    colours = torch.tensor([0.1, 0.2, 0.8]).expand(16, 3)
    before = float((learner.render(rays, 20).colour - colours).square().mean())
    for _ in range(6):
        learner.train_on(rays, colours)
    assert float((learner.render(rays, 20).colour - colours).square().mean()) < 0.7 * before


def test_a_thin_wall_does_not_hide_what_it_lets_through() -> None:
    """Transmittance e^-2 behind the first wall: the second one still counts."""
    rays, wall = rays_at(0.3, 40), AnalyticField(soft_shell(10.0, 0.5, 0.05))
    with torch.no_grad():
        stopped, whole = (render(wall, rays, 128, early_stop=stop) for stop in (True, False))
    assert torch.equal(stopped.colour, whole.colour)


@pytest.mark.parametrize("pointwise", [True, False])
def test_nothing_stops_with_gradients_or_where_density_depends_on_the_chunk(pointwise: bool) -> None:
    """Listing 2 takes its mean over the points of the chunk: leaving some out would change the others."""
    field = AnalyticField(homogeneous(1e4))
    field.pointwise = pointwise
    with torch.set_grad_enabled(pointwise):
        render(field, along_z(), 64, early_stop=True)
    assert field.points == 64
