"""The voxel field against torch: interpolation, quadrature, gradients, Adam, refinement. Needs Dr.Jit with LLVM."""

import math
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.nn.functional import softplus

from baselines.composition import DENSITY_SCALE, START
from baselines.contract import Box, Rays
from baselines.numerics.amplifier import softplus_shift
from baselines.numerics.quadrature import QUADRATURES
from tests.harness.tiny import rays_and_colours
from tests.harness.voxels import drjit_or_skip

BOX = Box(torch.tensor([-1.0, -0.8, -1.2]), torch.tensor([1.0, 1.0, 0.8]))
BINS = 24
SHIFT = softplus_shift(START / DENSITY_SCALE)


@pytest.fixture(scope="module", autouse=True)
def llvm() -> None:
    drjit_or_skip()


def rough(view_dependent: bool = True, voxels: int = 6) -> Any:
    """A field with something everywhere."""
    from baselines.voxels_drjit import VoxelField

    field = VoxelField(BOX, voxels, view_dependent, "llvm")
    generator = torch.Generator().manual_seed(5)
    for name, values in field.values.items():
        noise = torch.randn(len(values), generator=generator)
        field.values[name] = field.types.Float((4.0 + 2.0 * noise if name == "density" else noise).numpy())
    return field


def trilinear(grid: Tensor, x: Tensor) -> Tensor:
    """[z, y, x, channels] at [points, 3] of the world."""
    where = (2.0 * BOX.to_unit(x) - 1.0).reshape(1, -1, 1, 1, 3).to(grid.dtype)
    found = torch.nn.functional.grid_sample(
        grid.permute(3, 0, 1, 2).unsqueeze(0), where, align_corners=False, padding_mode="border"
    )
    return found.reshape(grid.shape[-1], -1).T


def harmonics(d: Tensor, degree: int) -> Tensor:
    """Real spherical harmonics from their definition."""
    even = torch.full_like(d[:, 0], 0.5 / math.sqrt(math.pi))
    slope = math.sqrt(3 / (4 * math.pi))
    return torch.stack([even, -slope * d[:, 1], slope * d[:, 2], -slope * d[:, 0]][: (degree + 1) ** 2], dim=-1)


def plain(state: dict[str, Tensor], rays: Rays, t: Tensor, edges: Tensor, degree: int) -> Tensor:
    """Colours of rays that all meet the box, from single torch operations in float64."""
    x = (rays.origins[:, None] + t[..., None] * rays.directions[:, None]).reshape(-1, 3)
    raw = trilinear(state["density"].unsqueeze(-1), x)[:, 0]
    sigma = DENSITY_SCALE * softplus(raw + SHIFT)
    basis = harmonics(rays.directions, degree).repeat_interleave(t.shape[1], dim=0)
    colour = torch.stack(
        [torch.sigmoid((trilinear(state[name], x) * basis).sum(dim=-1)) for name in ("red", "green", "blue")], dim=-1
    )
    w, T_end = QUADRATURES["midpoint"](sigma.reshape(t.shape), t, edges)
    return (w.unsqueeze(-1) * colour.reshape(*t.shape, 3)).sum(dim=1) + T_end.unsqueeze(-1)


def in_double(state: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name: value.double().requires_grad_() for name, value in state.items()}


def points(rays: Rays) -> tuple[Tensor, Tensor]:
    from baselines.numerics.bounds import ray_box
    from baselines.numerics.sampling import uniform_edges

    entry, leave, hit = ray_box(rays.origins, rays.directions, BOX.lower, BOX.upper, rays.near, rays.far)
    assert hit.all()
    edges = uniform_edges(entry, leave, BINS).double()
    return 0.5 * (edges[:, 1:] + edges[:, :-1]), edges


@pytest.mark.parametrize("view_dependent", [True, False])
def test_colours_and_gradients_are_those_of_autograd(view_dependent: bool) -> None:
    field = rough(view_dependent)
    rays, truth = rays_and_colours()
    state = in_double(field.state_dict())
    seen = plain(state, Rays(rays.origins.double(), rays.directions.double(), 2.0, 6.0), *points(rays), field.degree)
    loss = ((seen - truth) ** 2).mean()
    loss.backward()
    samples, inside = field.samples(rays, BINS, None)
    assert len(inside) == len(rays)
    none = torch.zeros(1, dtype=torch.int64)
    found, square, gradients = field.loss_and_gradients(samples, truth, 1.0 / truth.numel(), none, 0.0)
    assert found == pytest.approx(loss.item(), rel=1e-6)
    total = 0.0
    for name, value in state.items():
        assert value.grad is not None
        theirs = torch.as_tensor(gradients[name].numpy()).double().reshape(value.shape)
        assert float((theirs - value.grad).norm() / value.grad.norm()) < 5e-6, name
        total += float(value.grad.square().sum())
    assert square == pytest.approx(total, rel=1e-5)
    shown = field.render(rays, BINS).colour
    assert float((shown - seen.detach()).abs().max()) < 2e-6


def test_smoothing_pulls_towards_neighbours() -> None:
    field = rough()
    rays, truth = rays_and_colours()
    samples, _ = field.samples(rays, BINS, None)
    every = torch.arange(math.prod(field.shape))
    gradients = [field.loss_and_gradients(samples, truth, 1.0, every, amount)[2] for amount in (0.0, 1.0)]
    state = in_double(field.state_dict())
    total = sum(
        ((value.roll(-1, axis) - value).narrow(axis, 0, value.shape[axis] - 1) ** 2).sum()
        for value in state.values()
        for axis in range(3)
    )
    (total / math.prod(field.shape)).backward()
    for name, value in state.items():
        assert value.grad is not None
        pulled = torch.as_tensor(gradients[1][name].numpy() - gradients[0][name].numpy()).double()
        assert float((pulled.reshape(value.shape) - value.grad).norm() / value.grad.norm()) < 1e-4, name


@pytest.mark.parametrize("exponent", [-30, -8, -4, -2, -1, 0, 1, 2, 4])
def test_what_a_bin_loses_keeps_its_digits_and_its_gradient(exponent: int) -> None:
    import drjit as dr
    from drjit.llvm.ad import Float

    from baselines.voxels_drjit import lost

    tau = torch.tensor([0.3, 0.4999, 0.5001, 0.9]) * 10.0**exponent
    held = Float(tau.numpy())
    dr.enable_grad(held)
    found = lost(held)
    dr.backward(dr.sum(found))
    exact = tau.double()
    assert torch.allclose(torch.as_tensor(found.numpy()).double(), -torch.expm1(-exact), rtol=2e-6, atol=0.0)
    assert torch.allclose(torch.as_tensor(dr.grad(held).numpy()).double(), torch.exp(-exact), rtol=2e-6, atol=1e-37)


def test_a_refined_field_is_the_same_field() -> None:
    """A linear ramp keeps its values exactly inside the border."""
    from baselines.voxels_drjit import VoxelField

    field = VoxelField(BOX, 8, True, "llvm")
    assert field.shape == (8, 7, 8)
    ramp = torch.arange(8.0).expand(8, 7, 8)
    field.values["density"] = field.types.Float(ramp.reshape(-1).numpy())
    finer = field.refined(16)
    assert finer.shape == (16, 14, 16)
    grid = finer.state_dict()["density"]
    assert torch.allclose(grid[3, 3, 1:-1], torch.arange(16.0)[1:-1] / 2 - 0.25)
    assert finer.parameter_counts() == {"density_grid": 16 * 14 * 16, "colour_grid": 16 * 14 * 16 * 12,
                                        "total": 16 * 14 * 16 * 13}  # fmt: skip


def test_adam_steps_as_torch_does() -> None:
    from baselines.voxels_drjit import USUAL, Adam

    field = rough()
    state = {name: value.clone().requires_grad_() for name, value in field.state_dict().items()}
    theirs = torch.optim.Adam(list(state.values()), lr=1e-2, betas=USUAL.betas, eps=USUAL.epsilon)
    ours, generator = Adam(field), torch.Generator().manual_seed(2)
    for _ in range(5):
        gradients = {}
        for name, value in state.items():
            value.grad = 1e-5 * torch.randn(value.shape, generator=generator)
            gradients[name] = field.types.Float((2.0 * value.grad).reshape(-1).numpy())
        theirs.step()
        ours.step(field, gradients, 1e-2, 0.5)
    for name, value in field.state_dict().items():
        torch.testing.assert_close(value, state[name].detach(), rtol=1e-5, atol=1e-6)


def test_density_is_read_at_points_of_the_world() -> None:
    field = rough()
    x = BOX.from_unit(torch.rand(200, 3, generator=torch.Generator().manual_seed(3)))
    raw = trilinear(field.state_dict()["density"].double().unsqueeze(-1), x.double())[:, 0]
    expected = DENSITY_SCALE * softplus(raw + SHIFT)
    torch.testing.assert_close(field.density(x).double(), expected, rtol=1e-5, atol=1e-5)


def test_rays_that_miss_the_box_show_the_background() -> None:
    field = rough()
    away = Rays(torch.tensor([[0.0, 0.0, 4.0], [0.0, 0.0, 4.0]]), torch.tensor([[0.0, 0, 1], [0, 0, -1]]), 2.0, 6.0)
    seen = field.render(away, BINS)
    assert (seen.colour[0] == 1).all()
    assert (float(seen.opacity[0]), float(seen.depth[0])) == (0.0, 6.0)
    assert float(seen.opacity[1]) > 0.9
    assert 3.2 < float(seen.depth[1]) < 5.2
    assert seen.network_evaluations == BINS
    nowhere = field.render(away.part(0, 1), BINS)
    assert (nowhere.colour == 1).all()
    assert nowhere.network_evaluations == 0
