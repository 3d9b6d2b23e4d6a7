"""Compositing against a loop over rays and points."""

import pytest
import torch

from baselines.numerics.compositing import composite, expected_depth
from baselines.numerics.quadrature import midpoint


def test_composite_is_the_loop_of_equation_6_over_a_background() -> None:
    generator = torch.Generator().manual_seed(10)
    ray = torch.tensor([0, 0, 2, 2, 2, 4])  # rays 1 and 3 have no point
    w, values = torch.rand(6, generator=generator), torch.rand(6, 3, generator=generator)
    T_end, background = torch.rand(5, generator=generator), torch.tensor([1.0, 0.5, 0.0])
    expected = [[float(T) * float(b) for b in background] for T in T_end]
    for point in range(6):
        for channel in range(3):
            expected[int(ray[point])][channel] += float(w[point]) * float(values[point, channel])
    torch.testing.assert_close(composite(w, ray, values, T_end, background), torch.tensor(expected))


@pytest.mark.parametrize("scale", [1e-30, 1e-10, 1.0])
def test_depth_is_the_mean_distance_of_what_is_hit_at_any_opacity(scale: float) -> None:
    w, t = torch.tensor([[0.25, 0.25], [0.0, 0.5]]), torch.tensor([[2.0, 4.0], [3.0, 5.0]])
    torch.testing.assert_close(expected_depth(w * scale, t, 9.0), torch.tensor([3.0, 5.0]))


def test_depth_is_far_where_nothing_is_hit() -> None:
    w = torch.zeros(2, 3, requires_grad=True)
    depth = expected_depth(w, torch.ones(2, 3), 9.0)
    assert depth.tolist() == [9.0, 9.0]
    depth.sum().backward()
    assert torch.isfinite(w.grad).all()  # type: ignore[arg-type]


@pytest.mark.parametrize("length", [0.0, 1e-10, 1.0, 1e10, 1e30])
@pytest.mark.parametrize("density", [0.0, 1e-10, 1.0, 1e10, 1e30])
def test_colour_and_depth_have_finite_gradients_at_all_magnitudes(density: float, length: float) -> None:
    t_edges = length * torch.arange(7.0).unsqueeze(0)
    t, _ = midpoint.place(t_edges, None)
    sigma = torch.full((1, 6), density, requires_grad=True)
    w, T_end = midpoint(sigma, t, t_edges)
    colour = composite(w[0], torch.zeros(6, dtype=torch.long), torch.rand(6, 3), T_end, torch.ones(3))
    depth = expected_depth(w, t, 6.0 * length)
    (gradient,) = torch.autograd.grad(colour.sum() + depth.sum(), sigma)
    assert torch.isfinite(colour).all()
    assert torch.isfinite(gradient).all()
    assert 0.0 <= float(depth.detach()) <= 6.0 * length * (1.0 + 1e-6)
