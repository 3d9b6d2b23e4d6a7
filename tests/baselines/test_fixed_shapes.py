"""Marching with fixed shapes shows and learns what the march does that evaluates only the chosen points."""

from copy import deepcopy
from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from baselines.contract import Box, Rays, Rendering
from baselines.field import NetworkField, training_step
from baselines.marching.sampling_plan import Sampling
from baselines.numerics.encoding import PHI, encode, features_at, fourier_features, frequency_ladder
from baselines.occupancy import OccupancyGrid
from baselines.rendering import render_rays
from tests.baselines.small_fields import BOX, PARTS, SMALL, WHITE, every_method, field_of, roughened, some_rays

RAYS, MISSED = 60, slice(None, None, 3)
DOUBLE_BOX, DOUBLE_WHITE = Box(BOX.lower.double(), BOX.upper.double()), WHITE.double()


class DrawsOfAllRays:
    """Numbers for all rays, of which the march over the rays that hit takes its own."""

    def __init__(self, rows: Tensor | None) -> None:
        self.generator, self.rows = torch.Generator().manual_seed(5), rows

    def uniform(self, shape: tuple[int, ...], like: Tensor) -> Tensor:
        everything = torch.rand((RAYS, *shape[1:]), generator=self.generator).to(like)
        return everything if self.rows is None else everything[self.rows]


def rays() -> tuple[Rays, Tensor]:
    """Return rays, and the numbers of those that hit the box: a third misses it."""
    some, hit = some_rays(RAYS), torch.ones(RAYS, dtype=torch.bool)
    origins = some.origins.clone()
    origins[MISSED] += 20.0
    hit[MISSED] = False
    return replace(some, origins=origins), torch.nonzero(hit)[:, 0]


def half_empty() -> OccupancyGrid:
    grid = OccupancyGrid(4, DOUBLE_BOX, 0.02)
    grid.occupied = torch.rand(64, generator=torch.Generator().manual_seed(1)) < 0.5
    return grid


def taught(
    fields: list[NetworkField], sampling: Sampling, grid: OccupancyGrid | None
) -> tuple[Rendering, list[Tensor], list[Tensor]]:
    """Return the rendering of a step, its gradients, and the running means behind it; `fields` stay as they are."""
    modules = nn.ModuleList(map(deepcopy, fields))
    coarse, fine = (*modules, None)[:2]
    some, hit = rays()
    draws = DrawsOfAllRays(hit if sampling.clip_to_box and not sampling.fixed else None)
    with training_step(modules):
        double = some.to(torch.float64)
        shown = render_rays(coarse, fine, double, DOUBLE_BOX, sampling, grid, DOUBLE_WHITE, draws)  # type: ignore[arg-type]
        errors = [(colour**2).mean() for colour in (shown.colour, shown.coarse_colour) if colour is not None]
        torch.stack(errors).sum().backward()
    weights = list(modules.parameters())
    return shown, [torch.zeros_like(w) if w.grad is None else w.grad for w in weights], list(modules.buffers())


def in_double(field: NetworkField) -> NetworkField:
    """Return the field in double precision: in single, the gradient of α is a difference of nearly equal sums."""
    field = roughened(field).double()
    field.dtype, field.box = torch.float64, DOUBLE_BOX
    for name, bands in (("position", field.position_bands), ("direction", field.direction_bands)):
        setattr(field, f"{name}_omega", torch.pi * frequency_ladder(field.base, bands, torch.float64))
    return field


def agree(method: str, fields: list[NetworkField], sampling: Sampling, grid: OccupancyGrid | None = None) -> None:
    """Require pictures, gradients and running means equal to those of the exact march."""
    rule = PARTS[method].quadrature
    sampling = replace(sampling, quadrature=rule, clip_to_box=rule != "listing4")  # Listing 4 needs complete rays
    fields = list(map(in_double, fields))
    exact = taught(fields, replace(sampling, fixed=False), grid)
    fixed = taught(fields, sampling, grid)
    for name in ("colour", "opacity", "depth"):
        torch.testing.assert_close(getattr(fixed[0], name), getattr(exact[0], name), atol=1e-10, rtol=1e-10)
    for ours, theirs in zip((*fixed[1], *fixed[2]), (*exact[1], *exact[2]), strict=True):
        torch.testing.assert_close(ours, theirs, atol=1e-10, rtol=1e-7)
    counts = fixed[0].counts
    assert counts is not None
    assert int(counts.invalid) == 0


@every_method
@pytest.mark.parametrize(("capacity", "grid"), [(1.0, None), (0.7, None), (1.0, half_empty()), (0.6, half_empty())])
def test_all_packed_skipped_and_explored_points_agree_with_the_exact_march(
    method: str, capacity: float, grid: OccupancyGrid | None
) -> None:
    """Two thirds of the rays hit; a point that only fills the shape is in no mean of Listing 2 or Eq. 4."""
    if PARTS[method].quadrature == "listing4" and (grid is not None or capacity < 1.0):
        pytest.skip("has no grid, and needs all points")
    skipping = {} if grid is None else {"hidden": True, "exploration": 0.2}
    agree(method, [field_of(method)], Sampling(12, fixed=True, capacity=capacity, **skipping), grid)


@pytest.mark.parametrize("method", ["nerf", "qnerf", "qnerf_repaired"])
def test_coarse_and_fine_passes_agree(method: str) -> None:
    fields = [field_of(method, seed=seed) for seed in (0, 1)]
    agree(method, fields, Sampling(bins=8, fine_bins=6, fixed=True))


@pytest.mark.parametrize("width", [17, 20])
def test_no_width_need_be_a_multiple_of_8(width: int) -> None:
    size = replace(SMALL, width=width, colour_width=width - 6)
    agree("qnerf", [field_of("qnerf", size=size)], Sampling(bins=8, fixed=True))


def test_directions_are_seen_only_where_they_may_be() -> None:
    agree("nerf", [field_of("nerf", view_dependent=False)], Sampling(bins=8, fixed=True))


def test_what_does_not_fit_is_dropped_and_counted() -> None:
    """The last rays lose their points, and show the background."""
    shown, *_ = taught([in_double(field_of("nerf"))], Sampling(bins=12, fixed=True, capacity=0.25), None)
    assert shown.counts is not None
    assert float(shown.counts.needed) > 0.25
    assert float(shown.opacity[-5:].detach().abs().max()) == 0.0
    torch.testing.assert_close(shown.colour[-5:], DOUBLE_WHITE.expand(5, 3))
    assert float(shown.opacity[1].detach()) > 0.0


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0])
def test_invalid_densities_are_counted_and_raise_nothing(value: float, monkeypatch: pytest.MonkeyPatch) -> None:
    field = field_of("nerf")
    plain = NetworkField.density_and_colour_of_rays

    def spoilt(self: NetworkField, *given: Tensor) -> tuple[Tensor, Tensor]:
        sigma, colour = plain(self, *given)
        return sigma.index_fill(1, torch.tensor([2]), value), colour

    monkeypatch.setattr(NetworkField, "density_and_colour_of_rays", spoilt)
    some, hit = rays()
    shown = render_rays(field, None, some, BOX, Sampling(bins=4, fixed=True), None, WHITE, DrawsOfAllRays(None))
    assert shown.counts is not None
    assert int(shown.counts.invalid) == len(hit)


@pytest.mark.parametrize(("base", "bands"), [(2.0, 10), (PHI, 10), (2.0, 0)])
def test_its_features_are_those_of_listing_1_bit_for_bit(base: float, bands: int) -> None:
    x = 2.0 * torch.rand(50, 3, generator=torch.Generator().manual_seed(0)) - 1.0
    ladder = frequency_ladder(base, bands)
    assert torch.equal(features_at(x, torch.pi * ladder), fourier_features(x, ladder))
    assert torch.equal(features_at(x, torch.pi * ladder), encode(x, base, bands))
