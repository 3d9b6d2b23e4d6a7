"""The scene of Gaussians: its density, its first population, and what relocation keeps."""

import math

import pytest
import torch

from baselines.contract import Box, Rays
from baselines.splats.gaussians import Gaussians, Pencil
from baselines.splats.population import first_values, relocated, split_among
from harness.plan.seeds import generator_for

DEAD = 0.005
BOX = Box(-torch.ones(3), torch.tensor([1.0, 1.0, 0.5]))


def with_hull() -> Box:
    """A box of which a ball is left."""
    middle = (torch.arange(16) + 0.5) / 8 - 1.0
    x, y, z = torch.meshgrid(middle, middle, middle, indexing="ij")
    return Box(BOX.lower, BOX.upper, x**2 + y**2 + z**2 < 0.6)


def values(count: int = 50, box: Box = BOX) -> torch.Tensor:
    return first_values(box, count, 38, 0.1, generator_for(1, "first"))


def test_the_first_ones_lie_on_the_surface_of_the_hull_and_in_the_box() -> None:
    box = with_hull()
    unit = (values(400, box)[:, :3] / ((box.upper - box.lower) / box.half_extent)) + 0.5
    assert box.hull is not None
    cells = (unit * 16).long()
    assert bool(box.hull[tuple(cells.T)].all())
    assert float((2.0 * unit - 1.0).norm(dim=-1).min()) > 0.45
    assert float((values(400)[:, :3].abs() - torch.tensor([1.0, 1.0, 0.75])).max()) <= 0.0


def test_a_ray_through_the_middle_of_a_ball_loses_its_opacity_to_the_density() -> None:
    """The integral of the density along it is −log(1 − opacity)."""
    some = values(1)
    some[:, :3], some[:, 3:6], some[:, 10] = 0.0, math.log(0.1), math.log(0.7 / 0.3)
    field = Gaussians(BOX, 2, some, 1e-6, 0.5)
    line = torch.zeros(2001, 3)
    line[:, 0] = torch.linspace(-0.5, 0.5, 2001)
    line[:, 2] = -0.25  # the middle of the box
    tau = float(field.density(line).sum()) * 1.0 / 2000
    assert tau == pytest.approx(-math.log(0.3), rel=1e-3)


@pytest.mark.parametrize("copies", [1, 2, 5, 51])
def test_copies_let_through_as_much_as_the_one_that_they_replace(copies: int) -> None:
    opacity = torch.tensor([0.3, 0.9], dtype=torch.float64)
    each, factor = split_among(opacity, torch.full((2,), copies))
    torch.testing.assert_close((1.0 - each) ** copies, 1.0 - opacity)
    # Eq. 9 as printed
    total = sum(
        math.comb(i - 1, k) * (-1.0) ** k / math.sqrt(k + 1.0) * each ** (k + 1)
        for i in range(1, copies + 1)
        for k in range(i)
    )
    torch.testing.assert_close(factor * total, opacity)


def test_faint_ones_move_to_where_others_are_and_new_ones_join_them() -> None:
    some = values(50)
    some[:10, 10] = math.log(0.5 * DEAD)
    moved, changed = relocated(some.clone(), 5, DEAD, generator_for(0, "move"))
    assert len(moved) == 55
    opacity = torch.sigmoid(moved[:, 10])
    assert float(opacity.min()) >= DEAD * 0.999
    untouched = [place for place in range(50) if place not in set(changed.tolist())]
    assert torch.equal(moved[untouched], some[untouched])
    places = some[10:, :3]
    assert all(bool((places == moved[place, :3]).all(dim=1).any()) for place in [*range(10), *range(50, 55)])


def test_all_faint_or_none_leaves_them_as_they_are() -> None:
    some = values(4)
    some[:, 10] = -20.0
    assert torch.equal(relocated(some, 3, DEAD, generator_for(0, "move"))[0], some)
    some[:, 10] = 2.0
    kept, changed = relocated(some, 0, DEAD, generator_for(0, "move"))
    assert torch.equal(kept, some)
    assert len(changed) == 0


@pytest.mark.slow
def test_rays_of_several_cameras_are_drawn_camera_by_camera() -> None:
    field = Gaussians(BOX, 0, first_values(BOX, 80, 14, 0.1, generator_for(2, "first")), 0.02, 0.5)
    towards = torch.nn.functional.normalize(
        torch.tensor([[0.1, 0.0, -1.0], [0.0, 0.2, -1.0], [0.1, 0.2, -1.0]]), dim=-1
    )
    rays = [Rays(torch.tensor([[x, 0.0, 3.0]]).repeat(3, 1), towards, 1.0, 6.0) for x in (0.0, 0.5)]
    both = Rays(*(torch.cat([getattr(one, name) for one in rays]) for name in ("origins", "directions")), 1.0, 6.0)
    parts = [field.render(one) for one in rays]
    whole = field.render(both)
    for name in ("colour", "opacity", "depth"):
        torch.testing.assert_close(getattr(whole, name), torch.cat([getattr(part, name) for part in parts]))
    assert whole.network_evaluations == sum(part.network_evaluations for part in parts) > 0
    assert float(whole.opacity.max()) > 0.05


def test_depth_is_the_expected_distance_of_the_hit() -> None:
    """As of every other method: a ball of opacity 0.3 three units away is three units away."""
    ball = torch.tensor(
        [[0.0, 0.0, 0.0, *[math.log(0.01)] * 3, 1.0, 0.0, 0.0, 0.0, math.log(0.3 / 0.7), 0.0, 0.0, 0.0]]
    )
    field = Gaussians(BOX, 0, ball, 0.0, 0.0)
    towards = torch.nn.functional.normalize(torch.tensor([[0.0, 0.0, -1.0], [0.2, 0.0, -1.0]]), dim=-1)
    seen = field.render(Rays(torch.tensor([[0.0, 0.0, 2.75]]).repeat(2, 1), towards, 1.0, 6.0))
    assert seen.opacity.tolist() == pytest.approx([0.3, 0.0], abs=1e-4)
    assert seen.depth.tolist() == pytest.approx([3.0, 6.0], abs=1e-3)


def test_rays_that_span_half_a_sphere_are_refused() -> None:
    with pytest.raises(ValueError, match="half a sphere"):
        Pencil.of(torch.zeros(3), torch.tensor([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), 0.1)
