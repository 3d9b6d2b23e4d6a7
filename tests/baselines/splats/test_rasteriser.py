"""Splats against the slow reference, before the camera and nearly opaque, and what a picture must not depend on."""

import math

import pytest
import torch
from torch import Tensor

from baselines.splats.rasteriser import NEAREST, Drawn, Eye
from baselines.splats.ray_cells import RayCells
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


def drawn(values: Tensor, at: Tensor, widened: float = WIDENED, blurred: float = 0.0) -> tuple[Tensor, Tensor, int]:
    origin, axes = (part.to(values.dtype).numpy() for part in camera())
    return Drawn.apply(RayCells.of(at.numpy()), Eye(origin, axes, widened, blurred), values)


@pytest.mark.parametrize("blurred", [0.0, 1e-3])
@pytest.mark.parametrize("columns", [14, 23, 38, 59])
def test_picture_and_gradient_are_those_of_the_slow_reference(columns: int, blurred: float) -> None:
    values = scene(40, columns)
    origin, axes = camera()
    values[:3, :3] = origin + torch.tensor([[2.5, 0.1, 1.0], [-1.0, 5.0, 2.0], [3.0, -3.0, 1.0]]).double() @ axes.T
    values[:3, 3:6] += 1.0  # beside the camera, and large
    values.requires_grad_()
    at = rays()
    weight = torch.randn(len(at), 4, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    results = []
    for out, through, *_ in (drawn(values, at, WIDENED, blurred), plain(values, *camera(), WIDENED, at, blurred)):
        loss = (weight * out).sum() + (weight[:, 0] * through).sum()
        results.append((out, through, *torch.autograd.grad(loss, values)))
    for ours, theirs in zip(*results, strict=True):
        assert float(theirs.detach().abs().max()) > 0.1
        torch.testing.assert_close(ours, theirs, rtol=1e-6, atol=1e-7)
    assert float(results[1][2][:3].abs().max()) > 1e-3, "those beside the camera are seen"


def ball(scale: float, opacity: float, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Tensor:
    """Return one grey ball [1, 14]."""
    logit = math.log(opacity / (1.0 - opacity))
    return torch.tensor([[*at, *[math.log(scale)] * 3, 1.0, 0.0, 0.0, 0.0, logit, 0.0, 0.0, 0.0]], dtype=torch.float64)


def ahead() -> Tensor:
    """Return the one ray through the middle, and three that widen the plane's grid."""
    return torch.tensor([[0.0, 0.0], [0.1, 0.1], [-0.1, -0.1], [0.05, 0.0]], dtype=torch.float64)


@pytest.mark.parametrize(
    ("side", "depth", "scale", "nearest", "is_drawn"),
    [
        (0.0, -1.0, 0.1, NEAREST, False),  # behind the camera
        (0.0, 0.0, 0.1, NEAREST, False),  # in it
        (0.0, 0.5, 0.1, 0.51, False),  # before the near plane
        (0.0, 0.5, 0.1, 0.49, True),
        # far beside it, where a linear projection would cover the middle of the picture
        (0.5, 0.05, 0.05, NEAREST, False),
        (3.0, 0.3, 0.3, NEAREST, False),
        (-8.0, 1.0, 0.8, NEAREST, False),
    ],
)
def test_a_ball_is_drawn_only_before_the_camera(
    side: float, depth: float, scale: float, nearest: float, is_drawn: bool
) -> None:
    origin, axes = camera()
    place = (origin + side * axes[:, 0] + depth * axes[:, 2]).tolist()
    eye = Eye(origin.numpy(), axes.numpy(), 0.0, nearest=nearest)
    out, through, _ = Drawn.apply(RayCells.of(ahead().numpy()), eye, ball(scale, 0.9, tuple(place)))
    assert (float(out.abs().max()) > 0.0) == (float(through.min()) < 1.0) == is_drawn


def test_nothing_is_quite_opaque_and_what_cannot_be_seen_ends_the_ray() -> None:
    _, through, count = drawn(ball(0.5, 1.0 - 1e-9).repeat(9, 1), ahead()[:1].repeat(4, 1), widened=0.0)
    assert through.tolist() == pytest.approx([0.01**2] * 4, rel=1e-4) or float(through.max()) <= 0.01**2
    assert count <= 3 * 4


def test_the_same_bits_on_one_thread_and_on_three() -> None:
    values, at = scene(200, kind=torch.float32), rays(40, torch.float32)
    before = torch.get_num_threads()
    try:
        pictures = []
        for threads in (1, 3):
            torch.set_num_threads(threads)
            pictures.append(drawn(values, at))
    finally:
        torch.set_num_threads(before)
    assert torch.equal(pictures[0][0], pictures[1][0])
    assert torch.equal(pictures[0][1], pictures[1][1])
    assert pictures[0][2] == pictures[1][2]


@pytest.mark.parametrize("kind", ["some", "row", "column", "one", "the same"])
def test_a_ray_is_drawn_the_same_whatever_others_are_drawn_with_it(kind: str) -> None:
    """The cells of rays in a line are one row or column."""
    values, at = scene(60, kind=torch.float32), rays(20, torch.float32)
    number = torch.arange(len(at))
    some = {
        "some": number[::7],
        "row": number[at[:, 1] == at[:, 1].max()],
        "column": number[at[:, 0] == at[:, 0].min()],
        "one": number[:1],
        "the same": number[:1].repeat(5),
    }[kind]
    cells = RayCells.of(at[some].numpy())
    assert cells.rows * cells.columns <= 2 * len(some)
    out, through, _ = drawn(values, at)
    part, part_through, _ = drawn(values, at[some])
    torch.testing.assert_close(part, out[some], rtol=0, atol=1e-6)
    torch.testing.assert_close(part_through, through[some], rtol=0, atol=1e-6)
