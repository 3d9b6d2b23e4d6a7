"""The midpoint rule: closed forms by mpmath, gradients, limits; Listing 4 as a literal loop."""

import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest
import torch
from torch import Tensor

from baselines.numerics.quadrature import listing4, midpoint

MAGNITUDES = [0.0, 1e-10, 1e-5, 1e-2, 1.0, 1e2, 1e5, 1e10, 1e30]


def edges_and_points(near: float, far: float, bins: int, dtype: torch.dtype = torch.float64) -> tuple[Tensor, Tensor]:
    t_edges = torch.linspace(near, far, bins + 1, dtype=dtype).unsqueeze(0)
    return t_edges, 0.5 * (t_edges[:, 1:] + t_edges[:, :-1])


def random_rays(rays: int, bins: int, seed: int = 20) -> tuple[Tensor, Tensor, Tensor]:
    """Density, points and fenceposts of uneven bins, float64."""
    generator = torch.Generator().manual_seed(seed)
    lengths = torch.rand(rays, bins, dtype=torch.float64, generator=generator)
    t_edges = torch.cat([torch.full((rays, 1), 2.0, dtype=torch.float64), 2.0 + lengths.cumsum(-1)], dim=-1)
    sigma = 3.0 * torch.rand(rays, bins, dtype=torch.float64, generator=generator)
    return sigma, 0.5 * (t_edges[:, 1:] + t_edges[:, :-1]), t_edges


def plain_formula(sigma: Tensor, t_edges: Tensor) -> tuple[Tensor, Tensor]:
    """Eq. 6 with alpha and a running product, as a loop over bins."""
    T = torch.ones_like(sigma[:, 0])
    w = []
    for bin_ in range(sigma.shape[1]):
        alpha = 1.0 - torch.exp(-sigma[:, bin_] * (t_edges[:, bin_ + 1] - t_edges[:, bin_]))
        w.append(T * alpha)
        T = T * (1.0 - alpha)
    return torch.stack(w, dim=-1), T


def test_midpoint_is_equation_6_as_a_loop() -> None:
    sigma, t, t_edges = random_rays(20, 30)
    w, T_end = midpoint(sigma, t, t_edges)
    expected_w, expected_T = plain_formula(sigma, t_edges)
    torch.testing.assert_close(w, expected_w, rtol=0.0, atol=1e-14)
    torch.testing.assert_close(T_end, expected_T, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("bins", [1, 64, 4096])
@pytest.mark.parametrize("exponent", range(-8, 9))
def test_homogeneous_ray_in_float32_against_mpmath(bins: int, exponent: int) -> None:
    """Opacity and transmittance to 1e-6 relative, as far as float32 has numbers for them."""
    with mpmath.workdps(40):
        tau = mpmath.mpf(10) ** exponent
        opacity, transmittance = float(-mpmath.expm1(-tau)), float(mpmath.exp(-tau))
    t_edges, t = edges_and_points(0.0, 1.0, bins, torch.float32)
    w, T_end = midpoint(torch.full((1, bins), 10.0**exponent), t, t_edges)
    assert w.double().sum().item() == pytest.approx(opacity, rel=1e-6)
    # the absolute rounding of tau is a relative error of exp(-tau)
    assert T_end.item() == pytest.approx(transmittance, rel=1e-6 * max(1.0, 10.0**exponent), abs=1e-37)


def linear_profile(t: Tensor) -> Tensor:
    return 1.5 * t


def exponential_profile(t: Tensor) -> Tensor:
    return 3.0 * torch.exp(-1.3 * t)


def gaussian_profile(t: Tensor) -> Tensor:
    return 4.0 * torch.exp(-0.5 * ((t - 0.8) / 0.35) ** 2)


OPTICAL_DEPTH: dict[str, Callable[[mpmath.mpf], mpmath.mpf]] = {
    "linear": lambda t: 0.75 * t**2,
    "exponential": lambda t: 3.0 / 1.3 * -mpmath.expm1(-1.3 * t),
    "gaussian": lambda t: (
        4.0 * 0.35 * mpmath.sqrt(mpmath.pi / 2)
        * (mpmath.erf((t - 0.8) / (0.35 * mpmath.sqrt(2))) + mpmath.erf(0.8 / (0.35 * mpmath.sqrt(2))))
    ),
}  # fmt: skip
PROFILES = {"linear": linear_profile, "exponential": exponential_profile, "gaussian": gaussian_profile}
FAR = 1.5


def exact_opacity_and_colour(profile: str) -> tuple[float, float]:
    """Opacity, and the colour of matter that shines with cos 2t: ∫ c dA with A = 1 − exp(−τ), by parts."""
    with mpmath.workdps(20):
        tau = OPTICAL_DEPTH[profile]
        opacity = -mpmath.expm1(-tau(mpmath.mpf(FAR)))
        moved = mpmath.quad(lambda t: 2 * mpmath.sin(2 * t) * -mpmath.expm1(-tau(t)), [0, 0.4, 0.8, 1.2, FAR])
        return float(opacity), float(mpmath.cos(2 * FAR) * opacity + moved)


def order_of(errors: list[float], bins: list[int]) -> float:
    """Slope of log error on log bin length."""
    return -float(np.polyfit(np.log(bins), np.log(errors), 1)[0])


@pytest.mark.parametrize("profile", PROFILES)
def test_listing4_does_not_converge_where_light_reaches_the_far_end(profile: str) -> None:
    """Its last interval of 1e10 makes everything opaque: an error of exp(−τ) that more points do not reduce."""
    exact_opacity, _ = exact_opacity_and_colour(profile)
    counts = [64, 256, 1024, 4096]
    errors = []
    for bins in counts:
        t_edges, t = edges_and_points(0.0, FAR, bins)
        w, _ = listing4(PROFILES[profile](t), t, t_edges)
        errors.append(abs(float(w.sum()) - exact_opacity))
    assert order_of(errors, counts) == pytest.approx(0.0, abs=0.05)
    assert errors[-1] == pytest.approx(1.0 - exact_opacity, rel=0.01)


def test_stiff_bins_stay_within_half_a_bin_of_the_colour() -> None:
    """Order is lost where one bin is opaque; the error stays below h/2 · max|c'|."""
    for tau in (1e3, 1e5):
        with mpmath.workdps(20):
            exact = float((tau**2 * mpmath.mpf(1)) / (tau**2 + 4))  # ∫ tau e^(−tau t) cos 2t dt, to e^−tau
        for bins in (16, 64, 256):
            t_edges, t = edges_and_points(0.0, 1.0, bins)
            w, _ = midpoint(torch.full_like(t, tau), t, t_edges)
            assert abs(float((w * torch.cos(2 * t)).sum()) - exact) <= 1.1 * (0.5 / bins) * 2.0


def test_empty_space_is_the_background_exactly() -> None:
    _, t, t_edges = random_rays(5, 12)
    w, T_end = midpoint(torch.zeros_like(t), t, t_edges)
    assert torch.equal(w, torch.zeros_like(w))
    assert torch.equal(T_end, torch.ones_like(T_end))


@pytest.mark.parametrize("opaque", [0, 5, 11])
def test_huge_density_in_one_bin_is_that_bin_exactly(opaque: int) -> None:
    _, t, t_edges = random_rays(5, 12)
    sigma = torch.zeros_like(t)
    sigma[:, opaque] = 1e30
    w, T_end = midpoint(sigma, t, t_edges)
    assert torch.equal(w, torch.nn.functional.one_hot(torch.tensor([opaque] * 5), 12).double())
    assert torch.equal(T_end, torch.zeros_like(T_end))


def test_bins_without_length_contribute_nothing() -> None:
    sigma, t, t_edges = random_rays(5, 12)
    t_edges[:, 6] = t_edges[:, 5]
    w, T_end = midpoint(sigma, t, t_edges)
    assert torch.equal(w[:, 5], torch.zeros(5, dtype=torch.float64))
    sigma[:, 5] = 1e30
    again, T_again = midpoint(sigma, t, t_edges)
    assert torch.equal(again, w)
    assert torch.equal(T_again, T_end)


def test_many_bins_do_not_drift_in_float32() -> None:
    bins = 2**18
    t_edges = torch.linspace(0.0, 1.0, bins + 1, dtype=torch.float64).float().unsqueeze(0)
    w, T_end = midpoint(torch.full((1, bins), 5.0), t_edges[:, :-1], t_edges)
    assert T_end.item() == pytest.approx(math.exp(-5.0), rel=1e-5)
    assert w.double().sum().item() == pytest.approx(-math.expm1(-5.0), rel=1e-6)


def random_gradients(w: Tensor, T_end: Tensor) -> tuple[Tensor, Tensor]:
    generator = torch.Generator().manual_seed(21)
    return (
        torch.randn(w.shape, dtype=torch.float64, generator=generator).to(w.dtype),
        torch.randn(T_end.shape, dtype=torch.float64, generator=generator).to(w.dtype),
    )


def gradient_of(rule: Callable[[Tensor], tuple[Tensor, Tensor]], sigma: Tensor) -> Tensor:
    sigma = sigma.clone().requires_grad_()
    w, T_end = rule(sigma)
    torch.autograd.backward([w, T_end], list(random_gradients(w, T_end)))
    assert sigma.grad is not None
    return sigma.grad


def test_gradient_equals_that_of_the_plain_formula() -> None:
    sigma, t, t_edges = random_rays(20, 24)
    ours = gradient_of(lambda s: midpoint(s, t, t_edges), sigma)
    plain = gradient_of(lambda s: plain_formula(s, t_edges), sigma)
    torch.testing.assert_close(ours, plain, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("scale", [1e-8, 1e-4, 1.0, 10.0, 30.0])
def test_gradient_in_float32_against_float64(scale: float) -> None:
    """Also at 15 < τ of a bin, where the gradient of a stock `expm1` has no correct digit."""
    sigma, t, t_edges = random_rays(20, 24)
    sigma, t_edges = (sigma * scale).float(), t_edges.float()
    exact = gradient_of(lambda s: plain_formula(s, t_edges.double()), sigma.double())
    single = gradient_of(lambda s: midpoint(s, t.float(), t_edges), sigma)
    assert float((single - exact).abs().max()) <= 5e-6 * float(exact.abs().max())


def test_gradcheck() -> None:
    sigma, t, t_edges = random_rays(3, 7)
    sigma[0, 2] = 0.0
    sigma.requires_grad_()
    assert torch.autograd.gradcheck(lambda s: midpoint(s + 0.1, t, t_edges), (sigma,), atol=1e-9, rtol=1e-7)
    lengths = t_edges.clone().requires_grad_()
    assert torch.autograd.gradcheck(lambda e: midpoint(sigma.detach(), t, e), (lengths,), atol=1e-9, rtol=1e-7)


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


def test_listing4_makes_the_thinnest_haze_opaque() -> None:
    t_edges, t = edges_and_points(2.0, 6.0, 64)
    haze = torch.full_like(t, 1e-8)
    assert float(listing4(haze, t, t_edges)[0].sum()) == pytest.approx(1.0, abs=1e-6)
    assert float(midpoint(haze, t, t_edges)[0].sum()) == pytest.approx(4e-8, rel=1e-6)
