"""Fenceposts, points in bins, and the inverse distribution as a distribution."""

import numpy as np
import pytest
import torch
from scipy import stats
from torch import Tensor

from baselines.numerics.sampling import inverse_cdf_edges, jittered_edges, points_in_bins, uniform_edges


def generator(seed: int = 30) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def rising(t: Tensor) -> bool:
    return bool((t[:, 1:] >= t[:, :-1]).all())


def test_fenceposts_are_evenly_spaced_with_exact_ends() -> None:
    entry, leave = torch.tensor([2.0, 1.1, 3.3]), torch.tensor([6.0, 1.7, 3.3])
    edges = uniform_edges(entry, leave, 64)
    assert edges.shape == (3, 65)
    assert torch.equal(edges[:, 0], entry)
    assert torch.equal(edges[:, -1], leave)
    expected = [[a + (b - a) * k / 64 for k in range(65)] for a, b in [(2.0, 6.0), (1.1, 1.7), (3.3, 3.3)]]
    torch.testing.assert_close(edges, torch.tensor(expected), rtol=0.0, atol=1e-6)
    assert rising(edges)


@pytest.mark.parametrize("bins", [0, -3])
def test_no_bins_are_refused(bins: int) -> None:
    with pytest.raises(ValueError, match=f"bins must be >= 1, is {bins}"):
        uniform_edges(torch.zeros(1), torch.ones(1), bins)


def test_points_with_a_generator_are_uniform_in_their_bins() -> None:
    edges = torch.tensor([[0.0, 1.0, 4.0, 4.5]], dtype=torch.float64).expand(2000, 4)
    t = points_in_bins(edges, generator())
    share = (t - edges[:, :-1]) / torch.diff(edges)
    assert ((share >= 0) & (share <= 1)).all()
    for bin_ in range(3):
        assert stats.kstest(share[:, bin_].numpy(), "uniform").pvalue > 1e-3
    assert abs(float(torch.corrcoef(share.T)[0, 1])) < 0.1, "bins are jittered independently"


def step_function() -> tuple[Tensor, Tensor]:
    """Uneven fenceposts with an empty bin between full ones."""
    edges = torch.tensor([[2.0, 2.5, 3.5, 3.75, 5.0, 6.0]], dtype=torch.float64)
    return edges, torch.tensor([[0.2, 0.0, 0.5, 0.05, 0.1]], dtype=torch.float64)


def cdf_of(edges: Tensor, w: Tensor, t: float) -> float:
    """Mass below t, bin by bin."""
    mass = 0.0
    for left, right, weight in zip(edges[0].tolist(), edges[0].tolist()[1:], w[0].tolist(), strict=False):
        mass += weight * min(max((t - left) / (right - left), 0.0), 1.0)
    return mass / float(w.sum())


@pytest.mark.parametrize("random", [True, False])
def test_drawn_distances_follow_the_distribution(random: bool) -> None:
    edges, w = step_function()
    drawn = inverse_cdf_edges(edges, w, 4000, generator() if random else None)[0]
    assert not ((drawn > 2.5 + 1e-9) & (drawn < 3.5 - 1e-9)).any(), "in a bin without weight"
    result = stats.kstest(drawn.numpy(), lambda t: np.array([cdf_of(edges, w, value) for value in t]))
    assert result.statistic <= 1.01 / 4000, "strata put a point into each 4000th of the mass"


def test_independent_rays_follow_the_distribution() -> None:
    """One point a ray: no strata help."""
    edges, w = step_function()
    drawn = inverse_cdf_edges(edges.expand(4000, 6), w.expand(4000, 5), 1, generator())[:, 0]
    assert stats.kstest(drawn.numpy(), lambda t: np.array([cdf_of(edges, w, value) for value in t])).pvalue > 1e-3


def test_midpoints_of_the_strata_without_a_generator() -> None:
    edges = torch.tensor([[0.0, 1.0, 2.0]])
    drawn = inverse_cdf_edges(edges, torch.tensor([[1.0, 3.0]]), 4, None)
    torch.testing.assert_close(drawn, torch.tensor([[0.5, 1 + 1 / 6, 1.5, 1 + 5 / 6]]))


def test_a_ray_without_weight_is_sampled_uniformly() -> None:
    edges = uniform_edges(torch.tensor([2.0]), torch.tensor([6.0]), 8)
    drawn = inverse_cdf_edges(edges, torch.zeros(1, 8), 16, None)
    torch.testing.assert_close(drawn, 2.0 + 4.0 * (torch.arange(16) + 0.5).unsqueeze(0) / 16)


@pytest.mark.parametrize("bins", [1, 2, 9])
def test_jittered_fenceposts_keep_order_and_ends(bins: int) -> None:
    edges = uniform_edges(torch.full((500,), 2.0), torch.full((500,), 6.0), bins)
    moved = jittered_edges(edges, generator())
    assert moved.shape == edges.shape
    assert torch.equal(moved[:, [0, -1]], edges[:, [0, -1]])
    assert rising(moved)
    assert torch.equal(jittered_edges(edges, None), edges)
    if bins > 1:
        share = (moved[:, 1:-1] - edges[:, 1:-1]) * bins / 4.0
        assert stats.kstest(share.flatten().double().numpy(), "uniform", (-0.5, 1.0)).pvalue > 1e-3


@pytest.mark.parametrize("bins", [1, 16])
@pytest.mark.parametrize("length", [0.0, 1e-10, 1.0, 1e10, 1e30])
@pytest.mark.parametrize("weight", [0.0, 1e-45, 1e-30, 1e-10, 1.0, 1e10, 1e30, 3e38])
def test_distances_and_gradients_are_finite_and_rise_at_all_magnitudes(weight: float, length: float, bins: int) -> None:
    edges = (length * torch.rand(20, bins + 1, generator=generator()).cumsum(-1)).requires_grad_()
    w = weight * torch.rand(20, bins, generator=generator(1)) ** 4
    w[3, ::2] = 0.0
    w.requires_grad_()
    for source in (None, generator(2)):
        drawn = inverse_cdf_edges(edges, w, 64, source)
        assert rising(drawn), "to the last bit"
        assert ((drawn >= edges[:, :1]) & (drawn <= edges[:, -1:])).all()
        (gradient,) = torch.autograd.grad(drawn.sum(), edges)
        assert torch.isfinite(gradient).all()
        torch.testing.assert_close(gradient.sum(-1), torch.full((20,), 64.0))  # moved together, they all move
