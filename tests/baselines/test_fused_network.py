"""The hand-written network against the same network composed for autograd, in double precision."""

import pytest
import torch
from torch import Tensor, nn

from baselines import fused_network
from baselines.fused_network import Layout, evaluate

FEATURES, DIRECTIONS, WIDTH, COLOUR = 9, 5, 16, 12


def network(depth: int, skip: int, colour_layers: int, directions: int = DIRECTIONS) -> list[nn.Linear]:
    """Density layers, density head, colour layers, with random weights and biases."""
    widths = [WIDTH + FEATURES * (i == skip) for i in range(depth)]
    shapes = list(zip([FEATURES, *widths[:-1]], [WIDTH] * depth, strict=True))
    shapes += [(widths[-1], 1)]
    inner = [COLOUR] * colour_layers
    shapes += list(zip([widths[-1] + directions, *inner], [*inner, 3], strict=True))
    torch.manual_seed(depth + 10 * skip)
    return [nn.Linear(inputs, outputs, dtype=torch.float64) for inputs, outputs in shapes]


def composed(layers: list[nn.Linear], depth: int, skip: int, position: Tensor, view: Tensor, ray: Tensor) -> Tensor:
    """[raw density, colour logits], with concatenations where the paper has them."""
    h = position
    for i in range(depth):
        h = torch.relu(layers[i](h))
        if i == skip:
            h = torch.cat([h, position], dim=-1)
    raw = layers[depth](h)
    c = torch.cat([h, view[ray]], dim=-1)
    for j, layer in enumerate(layers[depth + 1 :]):
        c = layer(c if j == 0 else torch.relu(c))
    return torch.cat([raw, c], dim=-1)


def flat(layers: list[nn.Linear]) -> list[Tensor]:
    return [weight for layer in layers for weight in (layer.weight, layer.bias)]


def inputs(points: int, rays: int = 7, directions: int = DIRECTIONS) -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(points)
    position = torch.rand(points, FEATURES, generator=generator, dtype=torch.float64) * 2 - 1
    view = torch.rand(rays, directions, generator=generator, dtype=torch.float64) * 2 - 1
    return position, view, torch.randint(rays, (points,), generator=generator)


@pytest.fixture(params=[1 << 20, 1])
def _block(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """All points in one block, and in blocks of the smallest size."""
    monkeypatch.setattr(fused_network, "BLOCK_BYTES", request.param)
    monkeypatch.setattr(fused_network, "ROWS_MULTIPLE", 1024 if request.param > 1 else 64)


@pytest.mark.usefixtures("_block")
@pytest.mark.parametrize("points", [0, 1, 63, 64, 65, 300])
@pytest.mark.parametrize("directions", [0, DIRECTIONS])
@pytest.mark.parametrize(("depth", "skip", "colour_layers"), [(1, 0, 1), (2, 1, 2), (4, 3, 2), (6, 3, 2), (6, 4, 3)])
def test_outputs_and_every_gradient_agree_in_double_precision(
    depth: int, skip: int, colour_layers: int, directions: int, points: int
) -> None:
    layers = network(depth, skip, colour_layers, directions)
    position, view, ray = inputs(points, directions=directions)
    expected = composed(layers, depth, skip, position, view, ray)
    raw, logits = evaluate(Layout(depth, skip, torch.float64), position, view, ray, flat(layers))
    assert logits is not None
    found = torch.cat([raw.unsqueeze(-1), logits], dim=-1)
    torch.testing.assert_close(found, expected, rtol=1e-12, atol=1e-12)
    weight = torch.linspace(-1.0, 2.0, 4 * points, dtype=torch.float64).reshape(points, 4)
    reference = torch.autograd.grad((expected * weight).sum(), flat(layers))
    gradients = torch.autograd.grad((found * weight).sum(), flat(layers))
    for one, other in zip(gradients, reference, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-11, atol=1e-11)


def test_without_gradients_the_same_numbers_and_nothing_kept() -> None:
    layers = network(6, 3, 2)
    position, view, ray = inputs(200)
    layout = Layout(6, 3, torch.float64)
    raw, logits = evaluate(layout, position, view, ray, flat(layers))
    with torch.no_grad():
        again = evaluate(layout, position, view, ray, flat(layers))
        density, nothing = evaluate(layout, position, None, None, flat(layers))
    assert torch.equal(again[0], raw)
    assert logits is not None
    assert again[1] is not None
    assert torch.equal(again[1], logits)
    assert nothing is None
    torch.testing.assert_close(density, raw.detach(), rtol=1e-12, atol=1e-12)


def test_blocks_side_by_side_give_the_same_and_leave_the_threads_as_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fused_network, "BLOCK_BYTES", 1)
    monkeypatch.setattr(fused_network, "ROWS_MULTIPLE", 64)
    layers, before = network(6, 3, 2), torch.get_num_threads()
    position, view, ray = inputs(1500)
    weight = torch.linspace(-1.0, 2.0, 4 * 1500, dtype=torch.float64).reshape(1500, 4)
    found = []
    try:
        for threads in (1, 2, 3, 2):
            torch.set_num_threads(threads)
            raw, logits = evaluate(Layout(6, 3, torch.float64), position, view, ray, flat(layers))
            assert logits is not None
            outputs = torch.cat([raw.unsqueeze(-1), logits], dim=-1)
            found.append([outputs.detach(), *torch.autograd.grad((outputs * weight).sum(), flat(layers))])
            assert torch.get_num_threads() == threads
    finally:
        torch.set_num_threads(before)
    for other in found[1:]:
        torch.testing.assert_close(other, found[0], rtol=1e-11, atol=1e-11)
    assert all(torch.equal(first, again) for first, again in zip(found[1], found[3], strict=True))  # bit-identical


@pytest.mark.parametrize("points", [1, 1000, 1024, 1025, 3000])
def test_reduced_precision_errs_by_its_own_rounding(points: int) -> None:
    """bfloat16 has 8 bits: 2^-8 a product, a few of them in a row; sums and outputs are float32."""
    layers = [layer.float() for layer in network(6, 3, 2)]
    position, view, ray = (value.float() if value.is_floating_point() else value for value in inputs(points))
    exact = composed(layers, 6, 3, position, view, ray)
    raw, logits = evaluate(Layout(6, 3, torch.bfloat16), position, view, ray, flat(layers))
    assert logits is not None
    assert raw.shape == (points,)
    assert raw.dtype == logits.dtype == torch.float32
    error = (torch.cat([raw.unsqueeze(-1), logits], dim=-1) - exact).abs().max()
    assert error < 0.02 * exact.abs().max()


def test_a_second_derivative_is_refused() -> None:
    layers = network(2, 0, 1)
    position, view, ray = inputs(5)
    raw, _ = evaluate(Layout(2, 0, torch.float64), position, view, ray, flat(layers))
    (gradient,) = torch.autograd.grad(raw.square().sum(), [layers[0].weight], create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        gradient.sum().backward()
