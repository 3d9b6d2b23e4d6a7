"""The network, which builds no concatenation, against a plain one that does; its first weights."""

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from baselines.composition import ACTIVATIONS, Parts, skip_layer
from baselines.contract import Box
from baselines.field import NetworkField
from baselines.methods.nerf import NERF
from baselines.numerics.encoding import encode
from tests.baselines.small_fields import (
    BOX,
    PARTS,
    SMALL,
    every_depth,
    every_method,
    field_of,
    roughened,
    some_points,
)

PLAIN = {
    "relu": lambda x: x.clamp(min=0.0),
    "silu": lambda x: x / (1.0 + torch.exp(-x)),
    "softplus": lambda x: torch.log1p(torch.exp(x)),
}


def plain_field(field: NetworkField, parts: Parts, x: Tensor, d: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
    """Listing 3 and the heads with every concatenation built, reading the parameters of `field`."""
    between = PLAIN[parts.activation]
    released = parts.coordinates == "scene"
    per_pi = math.pi if released else 1.0
    position = encode((x if released else field.box.normalised(x)) / per_pi, field.base, field.position_bands)
    h = position
    for index, layer in enumerate(field.density_net):
        h = between(layer(h))
        if index == skip_layer(parts.skip, len(field.density_net)):
            h = torch.cat([h, position], dim=-1)
    sigma = field.density_unit * field.amplifier.rendered(field.density_head(h).squeeze(-1))
    if field.view_dependent:
        h = torch.cat([h, encode(d / per_pi, field.base, field.direction_bands)[ray]], dim=-1)
    for layer in list(field.colour_net)[:-1]:
        h = between(layer(h))
    return sigma, torch.sigmoid(field.colour_net[-1](h))


@every_method
@every_depth
@pytest.mark.parametrize("view_dependent", [True, False])
def test_field_equals_a_plain_one_with_concatenations(method: str, depth: int, view_dependent: bool) -> None:
    parts = PARTS[method]
    alpha = None if parts.amplifier == "none" else 0.9
    field = roughened(field_of(method, replace(SMALL, depth=depth), view_dependent=view_dependent), alpha)
    x, d, ray = some_points(700)
    sigma, colour = field.density_and_colour(x, field.encode_directions(d), ray)
    expected_sigma, expected_colour = plain_field(field, parts, x, d, ray)
    torch.testing.assert_close(colour, expected_colour, rtol=0.0, atol=1e-6)
    rounding = 2e-6 * max(25.0, parts.density_scale)
    torch.testing.assert_close(sigma, expected_sigma, rtol=5e-6, atol=rounding)
    torch.testing.assert_close(field.density(x), sigma, rtol=5e-6, atol=rounding)
    weights = [weight for name, weight in field.named_parameters() if not name.startswith("amplifier")]
    ours = torch.autograd.grad(colour.square().sum(), weights, allow_unused=True)
    plain = torch.autograd.grad(expected_colour.square().sum(), weights, allow_unused=True)
    for one, two in zip(ours, plain, strict=True):
        if two is not None:
            assert one is not None
            assert float((one - two).abs().max()) <= 2e-5 * max(1.0, float(two.abs().max()))


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_a_method_has_an_activation_a_depth_and_a_width_of_its_own(activation: str) -> None:
    parts = replace(NERF, activation=activation, depth=5, width=24)
    field = roughened(NetworkField(parts, SMALL, BOX, "float32", 0))
    assert [layer.out_features for layer in field.density_net] == [24] * 5
    x, d, ray = some_points(200)
    ours = field.density_and_colour(x, field.encode_directions(d), ray)
    for one, plain in zip(ours, plain_field(field, parts, x, d, ray), strict=True):
        torch.testing.assert_close(one, plain, rtol=5e-6, atol=2e-6 * parts.density_scale)
    assert parts.size(SMALL) == replace(SMALL, depth=5, width=24)
    assert NERF.size(SMALL) == SMALL, "without its own, as the run has it"


@every_method
def test_with_view_dependence_directions_change_colour_alone(method: str) -> None:
    field = roughened(field_of(method))
    x, d, ray = some_points(200)
    sigma, colour = field.density_and_colour(x, field.encode_directions(d), ray)
    other_sigma, other_colour = field.density_and_colour(x, field.encode_directions(-d), ray)
    assert torch.equal(sigma, other_sigma)
    assert torch.allclose(colour, other_colour) != PARTS[method].sees_direction


def test_what_an_encoding_sees_keeps_the_aspect_ratio() -> None:
    box = Box(torch.tensor([0.0, 0.0, 0.0]), torch.tensor([4.0, 2.0, 1.0]))
    corners = torch.tensor([[0.0, 0.0, 0.0], [4.0, 2.0, 1.0], [2.0, 1.0, 0.5]])
    assert box.normalised(corners).tolist() == [[-1.0, -0.5, -0.25], [1.0, 0.5, 0.25], [0.0, 0.0, 0.0]]
    assert torch.equal(box.from_unit(box.to_unit(corners)), corners)


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
def test_listing_2_alone_says_that_density_is_bounded(method: str) -> None:
    limit = PARTS[method].density_unit(BOX) if "listing2" in PARTS[method].amplifier else math.inf
    assert field_of(method).density_limit == limit


def test_dead_units_are_those_that_are_0_everywhere() -> None:
    field = field_of("nerf")
    roughened(field)
    assert max(field.dead_units().values()) < 0.5
    layer = field.density_net[1]
    with torch.no_grad():
        layer.weight[:4] = 0.0
        layer.bias[:4] = -1.0
    shares = field.dead_units()
    assert list(shares) == [f"density_net.{index}" for index in range(len(field.density_net))]
    assert shares["density_net.1"] >= 4 / layer.out_features
