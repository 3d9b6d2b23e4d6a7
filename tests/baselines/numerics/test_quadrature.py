"""Listing 4 as a literal loop, every rule against a slow reference and at its limits.

Orders, rounding and gradients of whole rays are measured by the stability cases Q1 to Q10, whose test fails with them.
"""

import math

import mpmath
import pytest
import torch
from torch import Tensor

from baselines.numerics.quadrature import QUADRATURES, Rule, listing4, midpoint
from harness.studies.stability.rays.exact_rays import weights_in_digits

MAGNITUDES = [0.0, 1e-10, 1e-5, 1e-2, 1.0, 1e2, 1e5, 1e10, 1e30]


def random_rays(rays: int, bins: int, seed: int = 20) -> tuple[Tensor, Tensor, Tensor]:
    """Density, points and fenceposts of uneven bins, float64."""
    generator = torch.Generator().manual_seed(seed)
    lengths = torch.rand(rays, bins, dtype=torch.float64, generator=generator)
    t_edges = torch.cat([torch.full((rays, 1), 2.0, dtype=torch.float64), 2.0 + lengths.cumsum(-1)], dim=-1)
    sigma = 3.0 * torch.rand(rays, bins, dtype=torch.float64, generator=generator)
    return sigma, 0.5 * (t_edges[:, 1:] + t_edges[:, :-1]), t_edges


@pytest.mark.parametrize("opaque", [0, 5, 11])
def test_huge_density_in_one_bin_is_that_bin_exactly(opaque: int) -> None:
    _, t, t_edges = random_rays(5, 12)
    sigma = torch.zeros_like(t)
    sigma[:, opaque] = 1e30
    w, T_end = midpoint(sigma, t, t_edges)
    assert torch.equal(w, torch.nn.functional.one_hot(torch.tensor([opaque] * 5), 12).double())
    assert torch.equal(T_end, torch.zeros_like(T_end))


def test_an_infinite_optical_depth_is_opaque() -> None:
    t_edges = torch.tensor([[0.0, 1e30, 2e30, 3e30]])
    sigma = torch.tensor([[0.0, 1e30, 1e30]], requires_grad=True)
    w, T_end = midpoint(sigma, t_edges[:, :-1], t_edges)
    assert w.tolist() == [[0.0, 1.0, 0.0]]
    assert T_end.tolist() == [0.0]
    w[:, 1].sum().backward()
    assert torch.isfinite(sigma.grad).all()  # type: ignore[arg-type]


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


def objective(rule: Rule, sigma: Tensor, lengths: Tensor) -> Tensor:
    w, T_end = rule.weights(sigma, lengths)
    generator = torch.Generator().manual_seed(53)
    g_w = torch.randn(w.shape, dtype=torch.float64, generator=generator).to(w.dtype)
    g_T = torch.randn(T_end.shape, dtype=torch.float64, generator=generator).to(w.dtype)
    return (w * g_w).sum() + (T_end * g_T).sum()


@every_rule
def test_gradcheck_of_every_rule(name: str) -> None:
    sigma, t, t_edges = random_case(QUADRATURES[name], rays=3, bins=7)
    lengths = QUADRATURES[name].lengths(t, t_edges)
    for scale in (0.01, 1.0, 5.0):
        s = (scale * (0.1 + sigma)).requires_grad_()
        assert torch.autograd.gradcheck(lambda s: QUADRATURES[name].weights(s, lengths), (s,), atol=1e-8)
    if name in SOUND:
        lengths.requires_grad_()
        assert torch.autograd.gradcheck(lambda ls: SOUND[name].weights(sigma, ls), (lengths,), atol=1e-8)


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
        (gradient,) = torch.autograd.grad(objective(rule, sigma, rule.lengths(t, t_edges)), sigma)
        assert torch.isfinite(gradient).all()


@every_sound_rule
def test_empty_bins_and_bins_without_length_contribute_nothing(name: str) -> None:
    rule = SOUND[name]
    sigma, t, t_edges = random_case(rule)
    w, T_end = rule(torch.zeros_like(sigma), t, t_edges)
    assert torch.equal(w, torch.zeros_like(w))
    assert torch.equal(T_end, torch.ones_like(T_end))
    lengths = torch.diff(t_edges)
    lengths[:, 4] = 0.0
    alone = torch.zeros_like(sigma)
    alone[:, 4 * rule.stride + rule.stride - 1] = 1e30  # in bin 4 alone, or at its front where bins share points
    if name in ("midpoint", "left", "linear"):
        w, T_end = rule.weights(alone, lengths)
        assert torch.equal(w, torch.zeros_like(w))
        assert torch.equal(T_end, torch.ones_like(T_end))


@every_rule
@pytest.mark.parametrize("rays", [0, 3])
@pytest.mark.parametrize("bins", [0, 4])
def test_no_rays_and_no_bins(name: str, rays: int, bins: int) -> None:
    rule = QUADRATURES[name]
    t, t_edges = rule.place(torch.arange(bins + 1.0).expand(rays, -1), None)
    sigma = torch.zeros_like(t, requires_grad=True)
    w, T_end = rule(sigma, t, t_edges)
    assert t.shape == w.shape == (rays, bins * rule.stride + rule.closed)
    assert torch.equal(w, torch.zeros_like(w))
    assert torch.equal(T_end, torch.full((rays,), 0.0 if rule.of_the_paper else 1.0))


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


@every_rule
def test_bins_and_their_points(name: str) -> None:
    """Brute force over which points belong to which bin."""
    rule = QUADRATURES[name]
    bins, points = 5, 5 * rule.stride + rule.closed
    belongs = torch.zeros(bins, points, dtype=torch.bool)
    for i in range(bins):
        belongs[i, i * rule.stride : (i + 1) * rule.stride + rule.closed] = True
    for marked in torch.eye(points, dtype=torch.bool):
        assert torch.equal(rule.bins_with(marked.unsqueeze(0))[0], (belongs & marked).any(-1))
    for pair in torch.eye(bins, dtype=torch.bool) | torch.eye(bins, dtype=torch.bool).roll(2, 0):
        assert torch.equal(rule.points_of(pair.unsqueeze(0))[0], belongs[pair].any(0))


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
