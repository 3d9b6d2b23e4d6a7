"""G1, G2: Gaussians far away, edge-on, next to the camera, in any order, nearly opaque; grids at the border."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product

import torch
from torch import Tensor

from baselines.grids.hash_grid import encoded
from baselines.grids.interpolation import PLANE_CHANNELS, TABLE_CHANNELS, Encoded, Multiplied
from baselines.grids.planes import multiplied
from baselines.splats.rasteriser import MOST_OPAQUE, Drawn, Eye
from baselines.splats.ray_cells import RayCells
from harness.plan.seeds import generator_for
from harness.records.study import check
from harness.studies.framework import Found
from harness.studies.stability.stability_context import StabilityContext, worst_of

PARTS = {"position": (0, 3), "scale": (3, 6), "rotation": (6, 10), "opacity": (10, 11), "colour": (11, 14)}
STEP = 1e-5


def gaussians(context: StabilityContext) -> Iterator[Found]:
    errors = [
        abs(_opacity(_ball(scale, opacity), distance)[0] / opacity - 1.0)
        for distance in (2.0, 20.0, 200.0)
        for scale in (1e-4, 1e-2, 1.0)
        for opacity in (0.05, 0.5, 0.98)
    ]
    yield check("relative error of opacity in the middle, near and far", max(errors), high=2e-6, subject="a ball")
    edge = torch.tensor([0.0, 0.004, 0.0])
    flat = _ball(0.2, 0.9)
    flat[:, 4] = math.log(1e-7)
    seen = _opacity(flat, 4.0, widened=0.01, at=edge)
    expected = 0.9 * math.exp(-0.5 * (4.0 * 0.004 / 0.01) ** 2)
    what = "relative error of opacity next to the edge"
    yield check(what, abs(seen[1] / expected - 1.0), high=1e-5, subject="a disc edge-on")
    beside = _ball(0.05, 0.9)
    beside[:, 0], beside[:, 2] = 0.5, 0.05 - 4.0
    what, seen = "opacity in the middle of the picture", _opacity(beside, 4.0)
    yield check(what, seen[0], high=0.0, subject="a ball 84° beside the axis")
    many = _many(50 if context.quick else 400)
    order = torch.randperm(len(many), generator=generator_for("stability", "order"))
    change = float((_picture(many)[0] - _picture(many[order])[0]).abs().max())
    yield check("change of a picture by the order in which Gaussians are listed", change, high=0.0, subject="many")
    opaque = _ball(0.5, 1.0 - 1e-12).float()
    opaque[:, 10] = 60.0
    out, through, _ = _picture(opaque.requires_grad_())
    (gradient,) = torch.autograd.grad(out.sum() + through.sum(), opaque)
    lost = int((~torch.isfinite(gradient)).sum())
    what, smallest = "gradients not finite where opacity rounds to 1", float(through.min().detach())
    yield check(what, lost, high=0, subject="gradient behind what is opaque")
    what = "transmittance where opacity rounds to 1"
    yield check(what, smallest, low=0.999 - MOST_OPAQUE, subject="behind what is opaque")
    for name, error in _slopes(_many(6).double()).items():
        what = "largest error against central differences, by the largest slope"
        yield check(what, error, high=1e-6, subject=f"gradient of {name}")


def grids(context: StabilityContext) -> Iterator[Found]:
    """Compare compiled interpolation with plain float64, at the border, beyond it, and with hash collisions."""
    draw = generator_for("stability", "grids")
    inside = 2.0 * torch.rand(200, 3, generator=draw) - 1.0
    corners = torch.cartesian_prod(*[torch.tensor([-1.0, 1.0])] * 3)
    beyond = 1.5 * (2.0 * torch.rand(50, 3, generator=draw) - 1.0)
    ulp = torch.nextafter(torch.ones(1), torch.zeros(1)) * corners
    x = torch.cat([inside, corners, ulp, beyond])
    planes = [torch.rand(3, size, size, PLANE_CHANNELS, generator=draw) for size in (2, 33, 128)]
    tables = [torch.rand(size, TABLE_CHANNELS, generator=draw) for size in (27, 64, 1)]
    cells = (2, 60, 9)
    plane, table = partial(Multiplied.apply, x), partial(Encoded.apply, x, cells)
    yield from _compared("planes", plane, partial(multiplied, x.double()), planes)
    yield from _compared("hash_grid", table, partial(encoded, x.double(), cells), tables)


def _compared(
    subject: str, compiled: Callable[..., Tensor], composed: Callable[..., Tensor], learnt: list[Tensor]
) -> Iterator[Found]:
    leaves = [values.clone().requires_grad_() for values in learnt]
    exact = [values.double().requires_grad_() for values in learnt]
    features, expected = compiled(*leaves), composed(*exact)
    what = "error of features, at the border and beyond"
    yield check(what, _relative_error(features, expected), high=2e-5, subject=f"{subject}, features")
    weight = torch.randn(features.shape, generator=generator_for("stability", "weights"))
    gradients = torch.autograd.grad((features * weight).sum(), leaves)
    truths = torch.autograd.grad((expected * weight).sum(), exact)
    worst = worst_of(map(_relative_error, gradients, truths))
    what = "error of the gradient, where nodes share an entry"
    yield check(what, worst, high=2e-5, subject=f"{subject}, gradient")


def _relative_error(features: Tensor, exact: Tensor) -> float:
    return float((features.detach().double() - exact.detach()).abs().max() / exact.detach().abs().max())


def _ball(scale: float, opacity: float) -> Tensor:
    logit = math.log(opacity / (1.0 - opacity))
    return torch.tensor([[0.0, 0.0, 0.0, *[math.log(scale)] * 3, 1.0, 0.0, 0.0, 0.0, logit, 0.0, 0.0, 0.0]])


def _many(count: int) -> Tensor:
    values = 0.3 * torch.randn(count, 14, generator=generator_for("stability", "Gaussians"))
    values[:, 3:6] -= 1.5
    values[:, 6] += 1.0
    return values


def _opacity(values: Tensor, distance: float, widened: float = 0.0, at: Tensor | None = None) -> list[float]:
    """Return the opacity along two rays: through the middle, and through the point `at` of the plane at distance 1."""
    points = torch.stack([torch.zeros(3), torch.zeros(3) if at is None else at, torch.ones(3)])[:, :2].numpy()
    eye = Eye(torch.tensor([0.0, 0.0, -distance]).numpy(), torch.eye(3).numpy(), widened)
    _, through, _ = Drawn.apply(RayCells.of(points), eye, values)
    lost: list[float] = (1.0 - through).tolist()
    return lost


def _picture(values: Tensor) -> tuple[Tensor, Tensor, int]:
    axis = torch.linspace(-0.25, 0.25, 24, dtype=values.dtype)
    points = torch.cartesian_prod(axis, axis).numpy()
    origin, axes = torch.tensor([0.0, 0.0, -4.0], dtype=values.dtype), torch.eye(3, dtype=values.dtype)
    drawn: tuple[Tensor, Tensor, int] = Drawn.apply(
        RayCells.of(points), Eye(origin.numpy(), axes.numpy(), 0.01), values
    )
    return drawn


def _slopes(values: Tensor) -> dict[str, float]:
    """Return part → largest difference from central differences, relative to the largest slope of that part."""

    def loss(some: Tensor) -> Tensor:
        out, through, _ = _picture(some)
        return (out[:, :3] + through[:, None]).square().mean()

    leaf = values.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(loss(leaf), leaf)
    slopes = torch.zeros_like(values)
    for place in product(*map(range, values.shape)):
        step = torch.zeros_like(values)
        step[place] = STEP
        slopes[place] = (loss(values + step) - loss(values - step)) / (2.0 * STEP)
    return {
        name: float((gradient - slopes)[:, low:high].abs().max() / slopes[:, low:high].abs().max())
        for name, (low, high) in PARTS.items()
    }
