"""Gaussians traced by Mitsuba against the same composed in torch. Needs Mitsuba with LLVM."""

import math
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from tests.baselines.splats.plain_splats import rotation
from tests.harness.voxels import drjit_or_skip


@pytest.fixture(scope="module", autouse=True)
def llvm() -> None:
    drjit_or_skip()


def numbers(values: Tensor) -> tuple[Tensor, ...]:
    """Return what Mitsuba is given of Gaussians [n, 14]: quaternions x, y, z, w."""
    data = torch.cat([values[:, :3], values[:, 3:6].exp(), normalize(values[:, 6:10], dim=-1)], dim=1)
    return data, torch.sigmoid(values[:, 10:11]), values[:, 11:]


def traced(values: Tensor) -> Any:
    from baselines.splats.traced import Traced

    return Traced(numbers(values))


def plain(values: Tensor, origins: Tensor, directions: Tensor) -> Tensor:
    """Return colours over white: each Gaussian has its largest value along a ray, the highest ones come first."""
    colour, through = torch.zeros_like(origins), torch.ones_like(origins[:, 0])
    for v in values[torch.argsort(values[:, 2], descending=True)]:
        turn, scales = rotation(v[[9, 6, 7, 8]]), v[3:6].exp()
        start, step = (origins - v[:3]) @ turn / scales, directions @ turn / scales
        nearest = start - ((start * step).sum(dim=-1) / (step * step).sum(dim=-1))[:, None] * step
        alpha = torch.sigmoid(v[10]) * torch.exp(-0.5 * nearest.square().sum(dim=-1))
        alpha = torch.where(alpha > 0.01, alpha, 0.0)  # where Mitsuba ends a Gaussian
        seen = (0.5 + 0.5 / math.sqrt(math.pi) * v[11:14]).clamp(min=0.0)
        colour, through = colour + (alpha * through)[:, None] * seen, through * (1.0 - alpha)
    return colour + through[:, None]


def scene() -> Tensor:
    """Return six Gaussians [6, 14], far enough apart in height that no ray meets two in another order."""
    draw = torch.Generator().manual_seed(0)
    values = 0.3 * torch.randn(6, 14, generator=draw)
    values[:, 0], values[:, 2] = torch.linspace(-0.4, 0.4, 6), torch.linspace(-1.0, 1.0, 6)
    values[:, 3:6] -= 1.7
    values[:, 9] += 0.7
    return values


def down(count: int = 1500) -> tuple[Tensor, Tensor]:
    draw = torch.Generator().manual_seed(1)
    towards = torch.cat([0.1 * torch.randn(count, 2, generator=draw), -torch.ones(count, 1)], dim=1)
    return torch.tensor([[0.0, 0.0, 4.0]]).repeat(count, 1), normalize(towards, dim=-1)


def test_pictures_and_gradients_are_those_of_torch() -> None:
    values, (origins, directions) = scene(), down()
    weight = torch.randn(len(origins), 3, generator=torch.Generator().manual_seed(2))
    ours, theirs = values.clone().requires_grad_(), values.double().requires_grad_()
    here = traced(ours)
    colour, through, _, met = here.trace(origins, directions)
    expected = plain(theirs, origins.double(), directions.double())
    assert float((colour - expected.detach()).abs().mean()) < 1e-4  # a ray at the edge may miss one, of at most 0.01
    assert 0.1 < float(1.0 - through.mean()) < 0.9
    assert met > len(origins)
    (weight * expected).sum().backward()
    torch.autograd.backward(list(numbers(ours)), list(here.gradient(origins, directions, colour, weight)))
    assert ours.grad is not None
    assert theirs.grad is not None
    for column in range(values.shape[1]):
        scale = float(theirs.grad[:, column].abs().max())
        torch.testing.assert_close(ours.grad[:, column].double(), theirs.grad[:, column], rtol=0, atol=0.02 * scale)


def test_depth_is_that_of_the_largest_density_and_a_miss_sees_white() -> None:
    ball = torch.tensor([[0.0, 0.0, 0.0, *[math.log(0.1)] * 3, 0.0, 0.0, 0.0, 1.0, math.log(9.0), 0.0, 0.0, 0.0]])
    directions = normalize(torch.tensor([[0.0, 0.0, -1.0], [1.0, 0.0, -1.0]]), dim=-1)
    colour, through, distance, met = traced(ball).trace(torch.tensor([[0.0, 0.0, 4.0]]).repeat(2, 1), directions)
    assert colour.flatten().tolist() == pytest.approx([0.55] * 3 + [1.0] * 3, abs=1e-5)
    assert through.tolist() == pytest.approx([0.1, 1.0], abs=1e-6)
    assert float(distance[0]) / 0.9 == pytest.approx(4.0, abs=1e-3)
    assert met == 1


def test_moved_numbers_are_those_of_a_scene_made_anew() -> None:
    values, rays = scene(), down(200)
    kept = traced(values)
    values[:, :2] += 0.05
    kept.move(numbers(values))
    assert torch.equal(kept.trace(*rays)[0], traced(values).trace(*rays)[0])
