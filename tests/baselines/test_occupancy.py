"""The occupancy grid: it keeps geometry, drops empty cells, and changes pictures by no more than its threshold."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.contract import Box
from baselines.marching.sampling_plan import Sampling
from baselines.occupancy import DECAY, HIDDEN, OccupancyGrid
from baselines.rendering import render_rays
from tests.baselines.analytic import AnalyticField, ball, cube, homogeneous, rays_at

BOX = cube(dtype=torch.float32)
CELLS = 16
THRESHOLD = 0.01
SIDE = 2.0 / CELLS
WHITE = torch.ones(3)


def generator(seed: int = 50) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def refreshed(field: AnalyticField, share: float = 1.0, times: int = 1, box: Box = BOX) -> OccupancyGrid:
    grid, source = OccupancyGrid(CELLS, box, THRESHOLD), generator()
    for _ in range(times):
        grid.refresh(field, share, source)
    return grid


def centres() -> Tensor:
    """Middle of each cell of `BOX`, in the grid's order: the last axis fastest."""
    axis = (torch.arange(CELLS) + 0.5) * SIDE - 1.0
    return torch.cartesian_prod(axis, axis, axis)


def least(densest: float) -> float:
    """The density that a cell needs to count as occupied where another has `densest`."""
    return -math.log1p(THRESHOLD * math.expm1(-densest * SIDE)) / SIDE


def cell_by_cell(density: Tensor) -> AnalyticField:
    """A field that is constant in each cell of the grid."""

    def sigma(x: Tensor) -> Tensor:
        index = ((x + 1.0) / SIDE).long().clamp(0, CELLS - 1)
        return density.to(x.dtype)[(index[:, 0] * CELLS + index[:, 1]) * CELLS + index[:, 2]]

    return AnalyticField(sigma)


def corner_alone() -> OccupancyGrid:
    density = torch.zeros(CELLS**3)
    density[0] = 100.0
    return refreshed(cell_by_cell(density))


def colours(field: AnalyticField, grid: OccupancyGrid | None, **options: object) -> Tensor:
    rays = rays_at(0.4, 200, dtype=torch.float32)
    sampling = Sampling(bins=64, exploration=float(options.get("exploration", 0.0)))  # type: ignore[arg-type]
    source = generator(7) if options.get("random") else None
    return render_rays(field, None, rays, BOX, sampling, grid, WHITE, source).colour


@pytest.mark.parametrize("share", [1.0, 0.25, 0.01])
def test_matter_is_never_dropped(share: float) -> None:
    """Cells completely inside a ball are kept, however few cells a refresh measures."""
    density = -math.log1p(-THRESHOLD) / SIDE * 1.01
    grid = OccupancyGrid(CELLS, BOX, THRESHOLD)
    whole = centres().norm(dim=-1) + 0.5 * math.sqrt(3.0) * SIDE < 0.7
    assert whole.sum() > 300
    source = generator()
    for _ in range(30):
        grid.refresh(AnalyticField(ball(density, 0.7)), share, source)
        assert grid.occupied[whole].all()


def test_a_box_with_unequal_sides_and_an_offset() -> None:
    box = Box(torch.tensor([1.0, -4.0, 2.0]), torch.tensor([2.0, -1.0, 2.5]))
    grid = refreshed(AnalyticField(lambda x: 100.0 * (x[:, 1] > -2.5).to(x.dtype)), box=box)
    x = box.from_unit(torch.rand(2000, 3, generator=generator()))
    clear = (x[:, 1] + 2.5).abs() > 3.0 / CELLS
    assert torch.equal(grid.occupied[grid.cell(x[clear])], x[clear][:, 1] > -2.5)


def test_points_outside_of_the_box_belong_to_the_nearest_cell() -> None:
    density = torch.zeros(CELLS**3)
    density[0], density[-1] = 100.0, 100.0
    grid = refreshed(cell_by_cell(density))
    assert grid.occupied[
        grid.cell(torch.tensor([[-1.0, -1.0, -1.0], [-9.0, -9.0, -9.0], [1.0, 1.0, 1.0], [9.0, 9.0, 9.0]]))
    ].all()
    assert not grid.occupied[grid.cell(torch.tensor([[0.0, 0.0, 0.0], [9.0, -9.0, 9.0]]))].any()


@pytest.mark.parametrize("random", [False, True])
def test_skipping_empty_cells_changes_nothing(random: bool) -> None:
    density = torch.where(torch.rand(CELLS**3, generator=generator()) < 0.1, 20.0, 0.0)
    field = cell_by_cell(density)
    grid = refreshed(field)
    assert torch.equal(grid.occupied, density > 0)
    without = colours(field, None, random=random)
    evaluations = field.points
    torch.testing.assert_close(colours(field, grid, random=random), without, rtol=0.0, atol=1e-6)
    assert field.points - evaluations < 0.3 * evaluations


@pytest.mark.parametrize("densest", [0.05, 1.0, 100.0])
def test_the_threshold_is_a_share_of_the_densest_cell(densest: float) -> None:
    """A method whose density is bounded by 1 (Listing 2) keeps its thin parts as one that can be opaque does."""
    density = torch.tensor([densest, least(densest) * 1.001, least(densest) * 0.999, 0.0]).repeat(CELLS**3 // 4)
    assert refreshed(cell_by_cell(density)).occupied.tolist() == [True, True, False, False] * (CELLS**3 // 4)


def test_dropped_haze_costs_no_more_than_the_threshold_allows() -> None:
    """A ray crosses at most √3 · cells cells' worth of haze that loses the threshold in each."""
    haze = least(20.0) * 0.99
    density = torch.where(torch.rand(CELLS**3, generator=generator()) < 0.02, 20.0, haze)
    field = cell_by_cell(density)
    grid = refreshed(field)
    assert torch.equal(grid.occupied, density > haze)
    bound = 1.0 - (1.0 - THRESHOLD) ** (math.sqrt(3.0) * CELLS)
    difference = float((colours(field, grid) - colours(field, None)).abs().max())
    assert 0.0 < difference <= bound


def test_exploration_evaluates_its_share_in_training_alone() -> None:
    """A share of 1 is as if there were no grid."""
    field, grid = AnalyticField(homogeneous(1.0)), corner_alone()
    without = colours(field, None, random=True)
    everything = field.points
    assert torch.equal(colours(field, grid, exploration=1.0, random=True), without)
    field.points = everything
    colours(field, grid, exploration=0.1, random=True)
    assert (field.points - everything) / everything == pytest.approx(0.1, abs=0.02)
    before = field.points
    colours(field, grid, exploration=0.1)
    assert field.points - before < 0.01 * everything, "no generator, no exploration"


def test_a_batch_in_which_no_sample_survives_is_background() -> None:
    """There is no gradient then, and nothing crashes."""
    grid = corner_alone()
    weight = torch.ones((), requires_grad=True)
    field = AnalyticField(lambda x: weight * homogeneous(5.0)(x))
    rays = rays_at(0.0, 9, dtype=torch.float32).part(0, 3)
    grid.occupied[:] = False
    for fine_bins in (0, 16):
        rendering = render_rays(
            field, field if fine_bins else None, rays, BOX, Sampling(32, fine_bins), grid, WHITE, generator()
        )
        assert torch.equal(rendering.colour, WHITE.expand(3, 3))
        assert torch.equal(rendering.opacity, torch.zeros(3))
        assert torch.equal(rendering.depth, torch.full((3,), 6.0))
        assert rendering.network_evaluations == 0
        rendering.colour.sum().backward()
        assert weight.grad is None or weight.grad == 0.0


def test_a_grid_that_finds_no_matter_is_full_again_and_says_so() -> None:
    grid = refreshed(AnalyticField(homogeneous(0.0)))
    assert grid.emptied
    assert grid.occupied_share() == 1.0
    grid.refresh(AnalyticField(ball(100.0, 0.5)), 1.0, generator())
    assert grid.occupied_share() < 0.3, "it works again as soon as there is geometry"


def test_matter_that_went_away_is_forgotten() -> None:
    grid = refreshed(AnalyticField(ball(10.0, 0.7)))
    inside = centres().norm(dim=-1) < 0.5
    refreshes = math.ceil(math.log(least(10.0) / 10.0) / math.log(DECAY))
    moved = AnalyticField(lambda x: 10.0 * (x[:, 0] > 0.9).to(x.dtype))
    for _ in range(refreshes - 1):
        grid.refresh(moved, 1.0, generator())
        assert grid.occupied[inside].all(), "but not at once"
    grid.refresh(moved, 1.0, generator())
    assert not grid.occupied[inside].any()


def test_number_of_evaluations() -> None:
    field, grid = AnalyticField(homogeneous(1.0)), OccupancyGrid(4, BOX, THRESHOLD)
    assert grid.refresh(field, 1.0, generator()) == 64
    assert grid.refresh(field, 0.25, generator()) == 16
    assert grid.refresh(field, 1e-6, generator()) == 1


def half_hull() -> Box:
    """`BOX`, of which nothing but x > 0 may hold anything."""
    hull = torch.zeros(CELLS, CELLS, CELLS, dtype=torch.bool)
    hull[CELLS // 2 :] = True
    return replace(BOX, hull=hull)


def test_nothing_outside_of_the_hull_is_evaluated_measured_or_brought_back() -> None:
    box, field = half_hull(), AnalyticField(homogeneous(100.0))
    within = centres()[:, 0] > 0
    grid = OccupancyGrid(CELLS, box, THRESHOLD)
    assert torch.equal(grid.occupied, within)
    source = generator()
    assert grid.refresh(field, 1.0, source) == int(within.sum())
    assert torch.equal(grid.occupied, within)
    grid = OccupancyGrid(CELLS, box, THRESHOLD)
    grid.refresh(AnalyticField(homogeneous(0.0)), 1.0, source)
    assert grid.emptied
    assert torch.equal(grid.occupied, within)
    assert bool(torch.isfinite(grid.density).all())


@pytest.mark.parametrize("cells", [5, 8, 16, 24, 32])
def test_a_hull_of_another_fineness_loses_no_cell(cells: int) -> None:
    hull = torch.rand(CELLS, CELLS, CELLS, generator=generator()) < 0.02
    grid = OccupancyGrid(cells, replace(BOX, hull=hull), THRESHOLD)
    inside = centres()[hull.flatten()]
    for corner in torch.cartesian_prod(*[torch.tensor([-0.49, 0.49])] * 3):
        assert grid.occupied[grid.cell(inside + corner * SIDE)].all()


def test_bins_behind_what_the_grid_measured_as_opaque_are_hidden_and_those_before_are_not() -> None:
    slab = AnalyticField(lambda x: 1000.0 * ((x[:, 0] > -0.25) & (x[:, 0] < 0.0)).to(x.dtype))
    grid = refreshed(slab)
    x = torch.stack([torch.linspace(-0.99, 0.99, 200), torch.full((200,), 0.1), torch.full((200,), 0.1)], dim=-1)
    lengths = torch.full((1, 200), 2.0 / 200)
    hidden = grid.hidden(grid.cell(x)[None], lengths)[0]
    inside = torch.cumsum(((x[:, 0] > -0.25) & (x[:, 0] < 0.0)) * 10.0, dim=0)
    assert not hidden[inside <= HIDDEN].any()
    assert hidden[inside > HIDDEN + 20.0].all()
    assert not refreshed(AnalyticField(homogeneous(HIDDEN / 2.0 - 0.1))).hidden(grid.cell(x)[None], lengths).any()
    assert not OccupancyGrid(CELLS, BOX, THRESHOLD).hidden(grid.cell(x)[None], lengths).any()  # nothing was measured


@pytest.mark.parametrize("pointwise", [True, False])
def test_hidden_points_are_left_out_of_training_alone_and_only_of_densities_of_their_own(pointwise: bool) -> None:
    """Listing 2 takes its mean over the points of a call: without the hidden ones training would see another field."""
    field = AnalyticField(ball(1000.0, 0.8))
    grid, rays = refreshed(field), rays_at(0.3, 100, dtype=torch.float32)
    field.pointwise = pointwise

    def evaluated(hidden: bool, source: torch.Generator | None) -> int:
        sampling = Sampling(bins=64, hidden=hidden)
        return render_rays(field, None, rays, BOX, sampling, grid, WHITE, source).network_evaluations

    whole = evaluated(False, generator(3))
    assert evaluated(True, None) == evaluated(False, None)
    assert (evaluated(True, generator(3)) < 0.6 * whole) == pointwise
    if not pointwise:
        assert evaluated(True, generator(3)) == whole
