"""Planes of features: the compiled interpolation against torch's, its border, and the field's first fog."""

import pytest
import torch

from baselines.contract import Box, FieldSpec, NetworkSize
from baselines.grids.interpolation import PLANE_CHANNELS, Multiplied
from baselines.grids.planes import multiplied, planes
from baselines.methods.explicit import PlaneSettings

NODES = (2, 5, 16)


def some_planes(seed: int = 0) -> list[torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return [torch.rand(3, size, size, PLANE_CHANNELS, generator=generator).requires_grad_() for size in NODES]


def points(count: int = 200, reach: float = 1.0, seed: int = 1) -> torch.Tensor:
    return reach * (2.0 * torch.rand(count, 3, generator=torch.Generator().manual_seed(seed)) - 1.0)


@pytest.mark.parametrize("reach", [1.0, 1.3])
def test_values_and_gradients_are_those_of_torch(reach: float) -> None:
    """Beyond the border, too."""
    x, tables, others = points(reach=reach), some_planes(), some_planes()
    weight = torch.randn(len(x), PLANE_CHANNELS * len(NODES), generator=torch.Generator().manual_seed(2))
    compiled, composed = Multiplied.apply(x, *tables), multiplied(x, *others)
    torch.testing.assert_close(compiled, composed, rtol=1e-5, atol=1e-6)
    compiled.backward(weight)
    composed.backward(weight)
    for table, other in zip(tables, others, strict=True):
        torch.testing.assert_close(table.grad, other.grad, rtol=1e-4, atol=1e-5)


def test_at_a_node_the_features_are_the_product_of_three_nodes() -> None:
    """The axes in the order xy, xz, yz."""
    table = some_planes()[1]
    i, j, k = 1, 4, 0
    x = torch.tensor([[2.0 * node / (NODES[1] - 1) - 1.0 for node in (i, j, k)]])
    expected = table[0, i, j] * table[1, i, k] * table[2, j, k]
    torch.testing.assert_close(Multiplied.apply(x, table)[0], expected)


def test_each_plane_is_linear_between_its_nodes() -> None:
    table = torch.ones(3, 3, 3, PLANE_CHANNELS)
    table[0] = torch.arange(3.0)[:, None, None]  # of the first axis alone
    x = torch.stack([torch.linspace(-1.0, 1.0, 9), torch.zeros(9), torch.zeros(9)], dim=-1)
    torch.testing.assert_close(Multiplied.apply(x, table)[:, 0], torch.linspace(0.0, 2.0, 9))


def test_the_same_input_gives_the_same_bits() -> None:
    x, weight = points(500), torch.randn(500, PLANE_CHANNELS * len(NODES), generator=torch.Generator().manual_seed(2))
    first, second = some_planes(), some_planes()
    Multiplied.apply(x, *first).backward(weight)
    Multiplied.apply(x, *second).backward(weight)
    assert all(torch.equal(one.grad, other.grad) for one, other in zip(first, second, strict=True))


@pytest.mark.parametrize("half", [1.0, 50.0])
@pytest.mark.parametrize("view_dependent", [True, False])
def test_it_begins_with_thin_fog_whatever_the_unit_of_length(half: float, view_dependent: bool) -> None:
    box = Box(-half * torch.ones(3), half * torch.ones(3))
    field = planes(FieldSpec(NetworkSize(), box, "float32", 0, view_dependent, PlaneSettings(NODES)))
    tau = field.density(half * points()).detach() * 2 * half
    assert 0.3 < float(tau.mean()) < 3.0
    view = field.encode_directions(torch.nn.functional.normalize(points(4), dim=-1))
    sigma, colour = field.density_and_colour(half * points(8), view, torch.arange(8) % 4)
    assert sigma.shape == (8,)
    assert colour.shape == (8, 3)
    assert field.parameter_counts()["encoder"] == 3 * PLANE_CHANNELS * sum(size**2 for size in NODES)


def test_the_compiled_field_learns_what_the_composed_one_learns() -> None:
    """Loss and gradient of every weight, features and network alike."""
    box = Box(-torch.ones(3), torch.ones(3))
    fields = [planes(FieldSpec(NetworkSize(), box, "float32", 0, True, PlaneSettings((4, 8)))) for _ in range(2)]
    x, d, ray = points(64), torch.nn.functional.normalize(points(4), dim=-1), torch.arange(64) % 4
    gradients = []
    for field, compiled in zip(fields, (True, False), strict=True):
        at = x if compiled else x.clone().requires_grad_()  # points with a gradient go through torch
        features, view = field.encoder(at), field.encode_directions(d)
        raw, logits = (field.decoder if compiled else field.decoder.composed)(features, view, ray)
        (raw.square().sum() + logits.square().sum()).backward()
        gradients.append({name: weight.grad for name, weight in field.named_parameters()})
    for name, gradient in gradients[0].items():
        torch.testing.assert_close(gradient, gradients[1][name], rtol=1e-4, atol=1e-4)
