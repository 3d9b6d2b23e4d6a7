"""Every method of the catalogue against the contract: being listed is being tested."""

from dataclasses import replace

import pytest
import torch

from baselines.amplifiers import Amplifier
from baselines.catalog import CATALOG
from baselines.contract import RadianceField
from baselines.field import NetworkField
from baselines.qnerf import QNERF
from tests.baselines.small_fields import (
    EIGHT,
    OF_THE_CALL,
    OF_THE_POINT,
    PARTS,
    SMALL,
    every_depth,
    every_method,
    field_of,
    render,
    roughened,
    some_points,
    some_rays,
)


@every_method
@every_depth
def test_builds_and_keeps_the_protocols(method: str, depth: int) -> None:
    field = field_of(method, replace(SMALL, depth=depth))
    assert isinstance(field, RadianceField)
    assert isinstance(field.amplifier, Amplifier)
    assert len(field.density_net) == depth
    assert CATALOG[method].title


@every_method
def test_weights_depend_on_the_seed_alone(method: str) -> None:
    one, same, other = field_of(method), field_of(method), field_of(method, seed=1)
    for (name, weight), again in zip(one.named_parameters(), same.parameters(), strict=True):
        assert torch.equal(weight, again), name
    assert not torch.equal(one.density_head.weight, other.density_head.weight)
    assert not torch.equal(one.density_head.weight, field_of(method, seed="0/fine").density_head.weight)


def test_building_leaves_the_global_generator_alone_in_effect() -> None:
    """Whatever torch's own initialisation draws, the weights do not depend on it."""
    torch.manual_seed(1)
    one = field_of("nerf")
    torch.manual_seed(2)
    for weight, again in zip(one.parameters(), field_of("nerf").parameters(), strict=True):
        assert torch.equal(weight, again)


def test_initial_weights_are_equal_between_methods_wherever_name_and_shape_are() -> None:
    reference = dict(field_of("nerf", EIGHT).named_parameters())
    for method in PARTS:
        shared = [
            (name, weight)
            for name, weight in field_of(method, EIGHT).named_parameters()
            if name in reference and weight.shape == reference[name].shape
        ]
        assert len(shared) >= len(reference) - 3, method
        for name, weight in shared:
            assert torch.equal(weight, reference[name]), (method, name)


def test_initial_weights_are_glorot_uniform_with_zero_biases() -> None:
    for name, weight in field_of("nerf", replace(SMALL, width=128)).named_parameters():
        if weight.ndim == 1:
            assert (weight == 0).all(), name
        else:
            bound = (6.0 / (weight.shape[0] + weight.shape[1])) ** 0.5
            assert weight.abs().max() <= bound, name
            if weight.numel() > 1000:
                assert float(weight.detach().std()) == pytest.approx(bound / 3**0.5, rel=0.1), name


@every_method
@every_depth
@pytest.mark.parametrize("view_dependent", [True, False])
def test_renders_finite_colours_in_range(method: str, depth: int, view_dependent: bool) -> None:
    field = roughened(field_of(method, replace(SMALL, depth=depth), view_dependent=view_dependent))
    rendering = render(field, PARTS[method], some_rays())
    for values in (rendering.colour, rendering.opacity, rendering.depth):
        assert torch.isfinite(values).all()
    assert ((rendering.colour >= 0) & (rendering.colour <= 1 + 1e-5)).all()
    assert ((rendering.opacity >= 0) & (rendering.opacity <= 1 + 1e-5)).all()
    assert ((rendering.depth >= 2) & (rendering.depth <= 6)).all()


@every_method
def test_rendering_is_deterministic(method: str) -> None:
    field = roughened(field_of(method))
    for seed in (None, 3):
        one, two = (
            render(field, PARTS[method], some_rays(), None if seed is None else torch.Generator().manual_seed(seed))
            for _ in range(2)
        )
        assert torch.equal(one.colour, two.colour)
        assert torch.equal(one.depth, two.depth)


@every_method
@every_depth
def test_gradients_reach_every_parameter(method: str, depth: int) -> None:
    """β of Listing 2 among them, as something lies above its threshold here."""
    field = roughened(field_of(method, replace(SMALL, depth=depth)))
    (render(field, PARTS[method], some_rays()).colour ** 2).sum().backward()
    for name, weight in field.named_parameters():
        assert weight.grad is not None, name
        assert torch.isfinite(weight.grad).all(), name
        assert (weight.grad != 0).any(), name


def test_beta_gets_no_gradient_where_nothing_is_above_the_threshold() -> None:
    field = field_of("qnerf")
    with torch.no_grad():
        field.density_head.bias.fill_(-20.0)
    render(field, QNERF, some_rays()).colour.sum().backward()
    assert field.amplifier.beta.grad == 0.0  # type: ignore[attr-defined]


@pytest.mark.parametrize("method", OF_THE_POINT)
@pytest.mark.parametrize("chunk", [1, 16, 50])
def test_chunks_do_not_matter_where_density_is_of_the_point(method: str, chunk: int) -> None:
    field, some = roughened(field_of(method), alpha=0.9), some_rays(100)
    whole = render(field, PARTS[method], some)
    parts = [render(field, PARTS[method], some.part(i, i + chunk)) for i in range(0, 100, chunk)]
    for name in ("colour", "opacity"):
        joined = torch.cat([getattr(part, name) for part in parts])
        torch.testing.assert_close(joined, getattr(whole, name), rtol=0.0, atol=2e-6)


@torch.no_grad()
def chunk_difference(field: NetworkField, method: str, chunk: int = 4) -> float:
    some, parts = some_rays(100), PARTS[method]
    pieces = [render(field, parts, some.part(i, i + chunk)).colour for i in range(0, 100, chunk)]
    return float((torch.cat(pieces) - render(field, parts, some).colour).abs().max())


@pytest.mark.parametrize("method", OF_THE_CALL)
def test_chunks_do_matter_with_a_mean_of_the_call_once_alpha_has_moved(method: str) -> None:
    """A documented property of the paper's operators: their mean is that of the call."""
    assert chunk_difference(roughened(field_of(method), alpha=1.0), method) > 1e-4


@pytest.mark.parametrize("method", [name for name in OF_THE_CALL if name != "qnerf_listing4"])
def test_chunks_do_not_matter_at_the_initial_alpha(method: str) -> None:
    """Eq. 4 is the identity there, up to rounding about a mean that differs."""
    assert chunk_difference(roughened(field_of(method)), method) <= 1e-4


@every_method
def test_bounded_density_is_bounded(method: str) -> None:
    field = roughened(field_of(method), alpha=2.0)
    sigma = field.density(some_points(500)[0])
    assert (sigma >= 0).all()
    assert field.amplifier.bounded == (PARTS[method].amplifier == "listing2")
    if field.amplifier.bounded:
        assert (sigma <= 1).all()
