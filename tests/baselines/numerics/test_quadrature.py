"""Listing 4 as a literal loop, every rule against a slow reference and at its limits.

Orders, rounding and gradients of whole rays are measured by the stability cases Q1 to Q10, whose test fails with them.
"""

import math

import mpmath
import pytest
import torch
from torch import Tensor

from baselines.numerics.quadrature import QUADRATURES, Rule, listing4
from harness.studies.stability.rays.exact_rays import weights_in_digits

MAGNITUDES = [0.0, 1e-10, 1e-5, 1e-2, 1.0, 1e2, 1e5, 1e10, 1e30]


def random_rays(rays: int, bins: int, seed: int = 20) -> tuple[Tensor, Tensor, Tensor]:
    """Density, points and fenceposts of uneven bins, float64."""
    generator = torch.Generator().manual_seed(seed)
    lengths = torch.rand(rays, bins, dtype=torch.float64, generator=generator)
    t_edges = torch.cat([torch.full((rays, 1), 2.0, dtype=torch.float64), 2.0 + lengths.cumsum(-1)], dim=-1)
    sigma = 3.0 * torch.rand(rays, bins, dtype=torch.float64, generator=generator)
    return sigma, 0.5 * (t_edges[:, 1:] + t_edges[:, :-1]), t_edges


def printed_listing4(density: list[float], z_vals: list[float], last: float = 1e10) -> list[float]:
    """Weights of one ray by Listing 4, number by number."""
    dists = [z_vals[i + 1] - z_vals[i] for i in range(len(z_vals) - 1)] + [last]
    transmittance, weights = 1.0, []
    for sigma, dist in zip(density, dists, strict=True):
        alpha = 1.0 - math.exp(-sigma * dist)
        weights.append(alpha * transmittance)
        transmittance *= 1.0 - alpha + 1e-10
    return weights


def test_listing4_is_the_printed_formula_as_a_loop() -> None:
    sigma, t, t_edges = random_rays(20, 15)
    sigma[3] = 0.0
    sigma[4, -1] = 0.0
    w, T_end = listing4(sigma, t, t_edges)
    expected = [printed_listing4(row, points) for row, points in zip(sigma.tolist(), t.tolist(), strict=True)]
    torch.testing.assert_close(w, torch.tensor(expected, dtype=torch.float64), rtol=1e-12, atol=1e-15)
    assert torch.equal(T_end, torch.zeros_like(T_end)), "it has no background"


SOUND = {name: rule for name, rule in QUADRATURES.items() if not rule.of_the_paper}
every_sound_rule = pytest.mark.parametrize("name", SOUND)
every_rule = pytest.mark.parametrize("name", QUADRATURES)


def random_case(rule: Rule, rays: int = 6, bins: int = 9, seed: int = 50) -> tuple[Tensor, Tensor, Tensor]:
    """Densities at the rule's points in uneven bins."""
    _, _, t_edges = random_rays(rays, bins, seed)
    t, t_edges = rule.place(t_edges, None)
    generator = torch.Generator().manual_seed(seed + 1)
    return 3.0 * torch.rand(t.shape, dtype=torch.float64, generator=generator), t, t_edges


@every_sound_rule
@pytest.mark.parametrize("scale", [1e-9, 1e-3, 0.3, 1.0, 8.0, 300.0])
def test_weights_are_those_of_the_slow_reference(name: str, scale: float) -> None:
    rule = SOUND[name]
    sigma, t, t_edges = random_case(rule, rays=2)
    sigma[1, 3] = 0.0
    w, T_end = rule(scale * sigma, t, t_edges)
    for ray in range(2):
        with mpmath.workdps(40):
            densities = [mpmath.mpf(one) for one in (scale * sigma[ray]).tolist()]
            exact = [float(one) for one in weights_in_digits(name, densities, torch.diff(t_edges[ray]).tolist())]
        torch.testing.assert_close(w[ray], torch.tensor(exact[:-1], dtype=torch.float64), rtol=2e-12, atol=1e-300)
        assert float(T_end[ray]) == pytest.approx(exact[-1], rel=1e-11, abs=1e-300)


@every_sound_rule
def test_weights_are_shares_that_sum_to_one(name: str) -> None:
    sigma, t, t_edges = random_case(SOUND[name], rays=100)
    for scale in MAGNITUDES:
        w, T_end = SOUND[name](sigma * scale, t, t_edges)
        assert ((w >= 0) & (w <= 1)).all()
        torch.testing.assert_close(w.sum(-1) + T_end, torch.ones(100, dtype=torch.float64), rtol=0.0, atol=1e-12)


@every_rule
def test_gradcheck_of_every_rule(name: str) -> None:
    """In the lengths as well; those of Listing 4 have a last one of 1e10."""
    rule = QUADRATURES[name]
    sigma, t, t_edges = random_case(rule, rays=3, bins=7)
    lengths = rule.lengths(t, t_edges).requires_grad_(name in SOUND)
    for scale in (0.01, 1.0, 5.0):
        assert torch.autograd.gradcheck(rule.weights, ((scale * (0.1 + sigma)).requires_grad_(), lengths), atol=1e-8)


@every_sound_rule
@pytest.mark.parametrize("length", MAGNITUDES)
@pytest.mark.parametrize("density", MAGNITUDES)
def test_outputs_and_gradients_are_finite_at_all_magnitudes(name: str, density: float, length: float) -> None:
    """Densities and lengths from 0 to 1e30 in float32 (the template of multinerf's tests)."""
    rule = SOUND[name]
    generator = torch.Generator().manual_seed(22)
    for varied in (1.0, 0.0):
        posts = length * torch.cat([torch.zeros(4, 1), torch.rand(4, 9, generator=generator).cumsum(-1)], dim=-1)
        t, t_edges = rule.place(posts, None)
        sigma = density * (1.0 - varied + varied * torch.rand(t.shape, generator=generator))
        sigma[1, ::2] = 0.0
        sigma.requires_grad_()
        w, T_end = rule(sigma, t, t_edges)
        assert torch.isfinite(w).all()
        assert torch.isfinite(T_end).all()
        assert ((w >= 0) & (w <= 1)).all()
        ((w * torch.randn(w.shape, generator=generator)).sum() + T_end.sum()).backward()
        assert torch.isfinite(sigma.grad).all()  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["midpoint", "left", "linear"])
def test_a_bin_without_length_contributes_nothing(name: str) -> None:
    rule = SOUND[name]
    sigma, _, t_edges = random_case(rule)
    lengths = torch.diff(t_edges)
    lengths[:, 4] = 0.0
    alone = torch.zeros_like(sigma)
    alone[:, 5 * rule.stride - 1] = 1e30  # a point of bin 4 alone
    w, T_end = rule.weights(alone, lengths)
    assert torch.equal(w, torch.zeros_like(w))
    assert torch.equal(T_end, torch.ones_like(T_end))


@every_rule
def test_points_lie_in_their_bins_in_training_and_without(name: str) -> None:
    rule = QUADRATURES[name]
    _, _, posts = random_rays(20, 7)
    for generator in (None, torch.Generator().manual_seed(3)):
        t, edges = rule.place(posts, generator)
        assert t.shape == (20, 7 * rule.stride + rule.closed)
        assert (torch.diff(t) >= 0).all()
        assert torch.equal(edges[:, [0, -1]], posts[:, [0, -1]]), "the whole ray is covered"
        assert (torch.diff(edges) >= 0).all()
        for i in range(7):
            own = t[:, i * rule.stride : (i + 1) * rule.stride + rule.closed]
            assert ((own >= edges[:, i : i + 1]) & (own <= edges[:, i + 1 : i + 2])).all()
        if generator is None:
            assert torch.equal(edges, posts)
        else:
            assert not torch.equal(t, rule.place(posts, None)[0])


@every_sound_rule
def test_bin_weights_are_what_bins_contribute(name: str) -> None:
    rule = SOUND[name]
    sigma, t, t_edges = random_case(rule)
    w, _ = rule(sigma, t, t_edges)
    lengths = torch.diff(t_edges)
    tau = rule.optical_depth(sigma, lengths)
    before = torch.exp(-torch.cumsum(torch.nn.functional.pad(tau, (1, 0))[:, :-1], dim=-1))
    expected = before * (1.0 - torch.exp(-tau))
    torch.testing.assert_close(rule.bin_weights(w, sigma, lengths), expected, rtol=1e-12, atol=1e-14)
