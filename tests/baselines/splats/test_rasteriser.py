"""Splats against the slow reference, closed forms and finite differences, and what a picture must not depend on."""

import pytest
import torch
from torch import Tensor

from baselines.splats.rasteriser import Drawn, RayCells
from tests.baselines.splats.plain_splats import drawn as plain

WIDENED = 0.01


def scene(count: int, columns: int = 38, seed: int = 0, kind: torch.dtype = torch.float64) -> Tensor:
    """Return Gaussians about the origin, of every shape, opacity and colour."""
    draw = torch.Generator().manual_seed(seed)
    values = 0.4 * torch.randn(count, columns, generator=draw, dtype=torch.float64)
    values[:, 3:6] = -2.0 + 0.5 * values[:, 3:6]
    values[:, 6] += 1.0
    values[:, 10] *= 6.0
    return values.to(kind)


def camera(kind: torch.dtype = torch.float64) -> tuple[Tensor, Tensor]:
    """Return an origin four lengths away, and axes that look at the middle from there."""
    forward = torch.nn.functional.normalize(torch.tensor([1.0, -2.0, 0.5], dtype=torch.float64), dim=0)
    right = torch.linalg.cross(forward, torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64))
    right = right / right.norm()
    axes = torch.stack([right, torch.linalg.cross(forward, right), forward], dim=1)
    return (-4.0 * forward).to(kind), axes.to(kind)


def rays(side: int = 14, kind: torch.dtype = torch.float64) -> Tensor:
    """Return points of the plane at distance 1, a shuffled grid."""
    axis = torch.linspace(-0.2, 0.2, side, dtype=torch.float64)
    points = torch.cartesian_prod(axis, axis)
    return points[torch.randperm(len(points), generator=torch.Generator().manual_seed(1))].to(kind)


def drawn(values: Tensor, at: Tensor, widened: float = WIDENED) -> tuple[Tensor, Tensor, int]:
    origin, axes = (part.to(values.dtype).numpy() for part in camera())
    return Drawn.apply(RayCells.of(at.numpy()), (origin, axes), widened, values)


@pytest.mark.parametrize("columns", [14, 38], ids=["one colour", "harmonics"])
def test_picture_and_gradient_are_those_of_the_slow_reference(columns: int) -> None:
    values, at = scene(40, columns).requires_grad_(), rays()
    weight = torch.randn(len(at), 4, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    results = []
    for out, through, *_ in (drawn(values, at), plain(values, *camera(), WIDENED, at)):
        loss = (weight * out).sum() + (weight[:, 0] * through).sum()
        results.append((out, through, *torch.autograd.grad(loss, values)))
    for ours, theirs in zip(*results, strict=True):
        assert float(theirs.detach().abs().max()) > 0.1
        torch.testing.assert_close(ours, theirs, rtol=1e-6, atol=1e-7)
