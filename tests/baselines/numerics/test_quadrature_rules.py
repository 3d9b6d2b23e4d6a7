"""What every quadrature rule must do: its declared order, gradients, limits, points, and bins that are left out."""

import mpmath
import pytest
import torch
from torch import Tensor

from baselines.numerics.checks import BadDensity, BadInterval
from baselines.numerics.quadrature import QUADRATURES, Rule
from tests.baselines.numerics.test_quadrature import (
    FAR,
    MAGNITUDES,
    PROFILES,
    edges_and_points,
    exact_opacity_and_colour,
    order_of,
    random_rays,
)

SOUND = {name: rule for name, rule in QUADRATURES.items() if not rule.of_the_paper}
every_sound_rule = pytest.mark.parametrize("name", SOUND)
every_rule = pytest.mark.parametrize("name", QUADRATURES)


def random_case(rule: Rule, rays: int = 6, bins: int = 9, seed: int = 50) -> tuple[Tensor, Tensor, Tensor]:
    """Densities at the rule's points in uneven bins."""
    _, _, t_edges = random_rays(rays, bins, seed)
    t, t_edges = rule.place(t_edges, None)
    generator = torch.Generator().manual_seed(seed + 1)
    return 3.0 * torch.rand(t.shape, dtype=torch.float64, generator=generator), t, t_edges


def exact_weights(name: str, sigma: list[mpmath.mpf], lengths: list[float]) -> list[mpmath.mpf]:
    """Weights of one ray and, last, T_end: the ends' shares of a bin by their definition as an integral."""
    stride, closed = QUADRATURES[name].stride, QUADRATURES[name].closed
    w = [mpmath.mpf(0)] * (stride * len(lengths) + closed)
    T = mpmath.mpf(1)
    for i, length in enumerate(lengths):
        at = sigma[stride * i : stride * (i + 1) + closed]
        tau = ((at[0] + 4 * at[1] + at[2]) / 6 if len(at) == 3 else sum(at) / len(at)) * mpmath.mpf(length)
        opacity = -mpmath.expm1(-tau)
        second = opacity / 2 if closed else mpmath.mpf(0)
        if name == "linear":  # ∫₀^τ e^−s s/τ ds
            second = mpmath.gammainc(2, 0, tau) / tau if tau else mpmath.mpf(0)
        w[stride * i] += T * (opacity - second)
        if closed:
            w[stride * (i + 1)] += T * second
        T *= mpmath.exp(-tau)
    return [*w, T]


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
            exact = [float(one) for one in exact_weights(name, densities, torch.diff(t_edges[ray]).tolist())]
        torch.testing.assert_close(w[ray], torch.tensor(exact[:-1], dtype=torch.float64), rtol=2e-12, atol=1e-300)
        assert float(T_end[ray]) == pytest.approx(exact[-1], rel=1e-11, abs=1e-300)


@every_sound_rule
def test_weights_are_shares_that_sum_to_one(name: str) -> None:
    sigma, t, t_edges = random_case(SOUND[name], rays=100)
    for scale in MAGNITUDES:
        w, T_end = SOUND[name](sigma * scale, t, t_edges)
        assert ((w >= 0) & (w <= 1)).all()
        torch.testing.assert_close(w.sum(-1) + T_end, torch.ones(100, dtype=torch.float64), rtol=0.0, atol=1e-12)


@every_sound_rule
@pytest.mark.parametrize("profile", PROFILES)
def test_order_is_the_declared_one(name: str, profile: str) -> None:
    rule = SOUND[name]
    exact_opacity, exact_colour = exact_opacity_and_colour(profile)
    counts = [16, 32, 64, 128, 256]
    opacity_errors, colour_errors = [], []
    for bins in counts:
        t, t_edges = rule.place(edges_and_points(0.0, FAR, bins)[0], None)
        w, T_end = rule(PROFILES[profile](t), t, t_edges)
        opacity_errors.append(abs(float(1.0 - T_end) - exact_opacity))
        colour_errors.append(abs(float((w * torch.cos(2 * t)).sum()) - exact_colour))
    assert order_of(colour_errors, counts) == pytest.approx(rule.orders.colour, abs=0.15)
    if profile == "linear" and name != "left":
        assert max(opacity_errors) <= 1e-12, "the mean of a linear density is exact"
    else:
        assert order_of(opacity_errors, counts) == pytest.approx(rule.orders.opacity, abs=0.15)


def test_only_the_linear_rule_sees_the_front_of_an_opaque_bin() -> None:
    """Homogeneous, 15 optical depths a bin: half a bin of colour is lost by the others, nothing by it."""
    tau, bins = 1e3, 64
    exact = float(mpmath.mpf(tau) ** 2 / (mpmath.mpf(tau) ** 2 + 4))
    errors = {}
    for name, rule in SOUND.items():
        t, t_edges = rule.place(edges_and_points(0.0, 1.0, bins)[0], None)
        w, _ = rule(torch.full_like(t, tau), t, t_edges)
        errors[name] = abs(float((w * (1.0 + torch.sin(2 * t))).sum()) - 1.0 - 2.0 * exact / tau)
    assert errors["linear"] <= 1e-5
    assert errors["midpoint"] == pytest.approx(1.0 / bins, rel=0.2)
    assert errors["trapezoid"] == pytest.approx(1.0 / bins, rel=0.2)


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
@pytest.mark.parametrize("scale", [1e-8, 1e-4, 0.05, 1.0, 10.0, 30.0])
def test_gradient_in_float32_against_float64(name: str, scale: float) -> None:
    sigma, _, t_edges = random_case(SOUND[name], rays=20, bins=24)
    lengths = torch.diff(t_edges).float()
    single, double = (scale * sigma).float().requires_grad_(), (scale * sigma).float().double().requires_grad_()
    (ours,) = torch.autograd.grad(objective(SOUND[name], single, lengths), single)
    (exact,) = torch.autograd.grad(objective(SOUND[name], double, lengths.double()), double)
    assert float((ours - exact).abs().max()) <= 5e-6 * float(exact.abs().max())


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


@every_sound_rule
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_refused(name: str, dtype: torch.dtype) -> None:
    sigma, t, t_edges = (values.to(dtype) for values in random_case(SOUND[name]))
    with pytest.raises(TypeError, match="float32 or better"):
        SOUND[name](sigma, t, t_edges)


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


@every_sound_rule
@pytest.mark.parametrize("wrong", [float("nan"), float("inf"), -1e-3])
def test_a_bad_density_is_refused_by_name_and_stays_on_its_ray(name: str, wrong: float) -> None:
    rule = SOUND[name]
    sigma, t, t_edges = random_case(rule)
    sound_w, sound_T = rule(sigma, t, t_edges)
    sigma[3, 5] = wrong
    with pytest.raises(BadDensity, match="sample 5 on ray 3") as caught:
        rule(sigma, t, t_edges)
    assert (caught.value.ray, caught.value.sample) == (3, 5)
    w, T_end = rule.weights(sigma, torch.diff(t_edges))
    others = torch.arange(6) != 3
    assert torch.equal(w[others], sound_w[others])
    assert torch.equal(T_end[others], sound_T[others])


@every_sound_rule
def test_distances_that_do_not_rise_are_refused_by_name(name: str) -> None:
    rule = SOUND[name]
    sigma, t, t_edges = random_case(rule)
    turned = t_edges.clone()
    turned[2] = turned[2].flip(-1)
    with pytest.raises(BadInterval, match="ray 2: distance 1 "):
        rule(sigma, t, turned)
    crossed = t.clone()
    crossed[4, 3] = crossed[4, 1]
    with pytest.raises(BadInterval, match="ray 4: distance 3 "):
        rule(sigma, crossed, t_edges)


@every_sound_rule
@pytest.mark.parametrize("tau", [1e-8, 1e-4, 0.1, 1.0, 3.0, 8.0, 15.6, 62.0])
def test_gradient_of_a_stiff_ray_keeps_its_digits(name: str, tau: float) -> None:
    """Smooth colours, equal bins: the gradient is a small difference of the large terms g T and Σ g w."""
    rule, bins = SOUND[name], 32
    t, _ = rule.place(edges_and_points(0.0, 1.0, bins)[0], None)
    lengths = torch.full((1, bins), tau)
    colour = 0.5 + 0.5 * torch.cos(3.0 * t)
    single = torch.ones(t.shape, requires_grad=True)
    (ours,) = torch.autograd.grad((rule.weights(single, lengths)[0] * colour.float()).sum(), single)
    exact = []
    with mpmath.workdps(60):
        shades = [mpmath.mpf(one) for one in colour.float().double()[0].tolist()]
        for i in range(3):
            value = []
            for step in (-1, 1):
                sigma = [mpmath.mpf(1)] * t.shape[1]
                sigma[i] += step * mpmath.mpf(10) ** -20
                value.append(
                    sum(w * c for w, c in zip(exact_weights(name, sigma, lengths[0].tolist()), shades, strict=False))
                )
            exact.append(float((value[1] - value[0]) / (2 * mpmath.mpf(10) ** -20)))
    assert float((ours[0, :3].double() - torch.tensor(exact)).abs().max()) <= 5e-6 * max(map(abs, exact))
