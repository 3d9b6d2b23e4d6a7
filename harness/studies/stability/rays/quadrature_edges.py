"""Q6 to Q10: rays through almost nothing and nothing, invalid rays, and importance sampling at its limits."""

import math
from collections.abc import Callable, Iterator
from functools import partial

import torch
from torch import Tensor

from baselines.contract import Box, Rays, Rendering
from baselines.marching.sampling_plan import Sampling
from baselines.numerics.checks import BadDensity, BadInterval
from baselines.numerics.compositing import composite, expected_depth
from baselines.numerics.quadrature import QUADRATURES, Rule
from baselines.numerics.sampling import inverse_cdf
from baselines.rendering import render_rays
from harness.records.study import check
from harness.studies.framework import Found
from harness.studies.stability.rays.exact_rays import OURS, FunctionField, owner_of
from harness.studies.stability.rays.usual_quadrature import running_product
from harness.studies.stability.stability_context import StabilityContext, error_of, none_of, worst_of

NEAR, FAR, BINS = 2.0, 6.0, 64
BACKGROUND = torch.tensor([0.25, 0.5, 1.0])
ACROSS = (-0.5, -0.25, 0.0, 0.25, 0.5)
"""Where five parallel rays through the box run."""


def everywhere(sigma: float) -> Callable[[Tensor], Tensor]:
    return lambda x: torch.full_like(x[:, 0], sigma)


def fourth_ray(sigma: float) -> Callable[[Tensor], Tensor]:
    """Return a density of `sigma` on the fourth of the five rays and 1 on the others."""
    return lambda x: torch.where((x[:, 0] - ACROSS[3]).abs() < 1e-3, sigma, 1.0)


def rendered(
    density: Callable[[Tensor], Tensor],
    rule: str,
    near: float = NEAR,
    far: float = FAR,
    clip: bool = False,
    across: tuple[float, ...] = ACROSS,
) -> Rendering:
    """Render parallel rays through or past the box ±1; cut to it with `clip`, else from near to far."""
    origins = torch.tensor([[x, 0.0, 4.0] for x in across])
    rays = Rays(origins, torch.tensor([0.0, 0.0, -1.0]).expand(len(across), 3), near, far)
    field = FunctionField(density, lambda x: torch.full_like(x, 0.75))
    sampling = Sampling(BINS, quadrature=rule, clip_to_box=clip)
    return render_rays(field, None, rays, Box(-torch.ones(3), torch.ones(3)), sampling, None, BACKGROUND, None)


def posts(rays: int = 1, bins: int = BINS) -> Tensor:
    return torch.linspace(NEAR, FAR, bins + 1).expand(rays, -1).contiguous()


def almost_nothing(context: StabilityContext) -> Iterator[Found]:
    exact = -math.expm1(-1e-8 * (FAR - NEAR))
    for name, rule in QUADRATURES.items():
        opacity = float(rendered(everywhere(1e-8), name).opacity[0])
        steepest = worst_of(_steepest(rule, sigma) for sigma in (1e-8, 1e-10, 1e-12))
        why = f"opacity {opacity:.3g}; ∂opacity/∂σ at most {steepest:.2g} for σ = 1e-8 to 1e-12"
        error = abs(opacity / exact - 1.0)
        yield check("relative error of opacity", error, high=1e-6, why=why, subject=name, owner=owner_of(name))
        if not rule.of_the_paper:
            what = "largest ∂opacity/∂σ of a sample, at most the length of a bin"
            yield check(what, steepest, high=1.001 * (FAR - NEAR) / BINS, subject=name)
    lengths = torch.diff(posts(), dim=-1)
    w, _ = running_product(torch.full_like(lengths, 1e-8), lengths)
    error = abs(float(w.sum()) / exact - 1.0)
    yield check("relative error of opacity", error, high=1e-6, subject="running product", owner="usual")


def _steepest(rule: Rule, sigma: float) -> float:
    t, t_edges = rule.place(posts(), None)
    density = torch.full_like(t, sigma).requires_grad_()
    (gradient,) = torch.autograd.grad(rule.weights(density, rule.lengths(t, t_edges))[0].sum(), density)
    return float(gradient.abs().max())


def nothing(context: StabilityContext) -> Iterator[Found]:
    solid = everywhere(50.0)
    for name, rule in QUADRATURES.items():
        renderings = {
            "near = far": (rendered(solid, name, 3.0, 3.0), 3.0),
            "an empty ray": (rendered(everywhere(0.0), name), FAR),
            "a box without depth": (rendered(solid, name, clip=True, across=(5.0,)), FAR),
        }
        figures = {}
        for what, (seen, far) in renderings.items():
            gaps = [seen.opacity.abs().max(), (seen.colour - BACKGROUND).abs().max(), (seen.depth - far).abs().max()]
            figures[what] = worst_of(map(float, gaps))
        t, t_edges = rule.place(posts(3)[:, :1], None)
        w, T_end = rule.weights(torch.full_like(t, 50.0), rule.lengths(t, t_edges))
        figures["no bins"] = float((w.sum(dim=-1).abs() + (T_end - 1.0).abs()).max())
        wrong = [f"{what}: {figure:.3g}" for what, figure in figures.items() if figure != 0.0]
        why = "; ".join(wrong) or f"exact in {len(figures)} situations"
        what = "largest distance from opacity 0, colour = background, depth = far"
        worst = worst_of(figures.values())
        yield check(what, worst, high=0.0, why=why, subject=name, owner=owner_of(name))
    w = torch.zeros(BINS)
    depth = (w * torch.linspace(NEAR, FAR, BINS)).sum() / w.sum()
    disparity = float(1.0 / torch.maximum(torch.tensor(1e-10), depth))
    what, subject = "disparity of an empty ray, whose depth is far", "disparity 1 / max(1e-10, Σwt/Σw)"
    yield check(what, disparity, high=1.0 / FAR, subject=subject, owner="usual")


def no_interval(context: StabilityContext) -> Iterator[Found]:
    backwards = {"far < near": (6.0, 2.0), "far = ∞": (2.0, math.inf), "far NaN": (2.0, math.nan)}
    for name, rule in QUADRATURES.items():
        accepted = [
            what for what, (near, far) in backwards.items()
            if error_of(BadInterval, rendered, everywhere(0.0), name, near, far) is None
        ]  # fmt: skip
        yield none_of("intervals that the renderer does not refuse", accepted, name)
        t, t_edges = rule.place(posts(8), None)
        mixed = t_edges.clone()
        mixed[5] = mixed[5].flip(-1)
        if rule.of_the_paper:
            lengths = rule.lengths(rule.place(mixed, None)[0], mixed)
            opacity, without = (float(rule.weights(torch.ones_like(t), some)[0][5].sum())
                                for some in (lengths, lengths.clamp(max=1.0)))  # fmt: skip
            what = "opacity of a ray whose distances fall"
            why = f"accepted; {without:.3g} where its last interval is 1 instead of 1e10"
            yield check(what, abs(opacity), high=0.0, why=why, subject=name, owner="paper")
            continue
        error = error_of(BadInterval, rule, torch.ones_like(t), t, mixed)
        named = "accepted" if error is None else "" if error.ray == 5 else f"names ray {error.ray}, not 5"
        yield check("unsorted rays accepted or misnamed", float(bool(named)), high=0.0, why=named, subject=name)
    falling = -torch.diff(posts(), dim=-1)
    opacity = float(running_product(torch.ones_like(falling), falling)[0].sum())
    what, why = "|opacity| of a ray whose distances fall", f"opacity {opacity:.3g}, without a message"
    yield check(what, abs(opacity), high=0.0, why=why, subject="running product", owner="usual")


def bad_sample(context: StabilityContext) -> Iterator[Found]:
    rays, ray, sample = 16, 11, 7
    for name in OURS:
        rule = QUADRATURES[name]
        t, t_edges = rule.place(posts(rays), None)
        valid = 2.0 * torch.rand(t.shape, generator=torch.Generator().manual_seed(9))
        before = _pixels(rule, valid, t, t_edges)
        unnamed, changed = [], 0
        for wrong in (math.nan, math.inf, -1.0):
            sigma = valid.clone()
            sigma[ray, sample] = wrong
            error = error_of(BadDensity, rule, sigma, t, t_edges)
            if error is None or (error.ray, error.sample) != (ray, sample):
                unnamed.append(f"{wrong} {'misnamed' if error else 'accepted'}")
            error = error_of(BadDensity, partial(rendered, fourth_ray(wrong), name, clip=True))
            if error is None or error.ray != 3:
                unnamed.append(f"{wrong} not named by the renderer")
            after = _pixels(rule, sigma, t, t_edges)
            others = torch.arange(rays) != ray
            changed += int((after[others] != before[others]).any(dim=-1).sum())
        yield none_of("bad samples accepted or misnamed", unnamed, name)
        yield check("other rays with a changed bit, without checks (audit)", float(changed), high=0.0, subject=name)
    # nan_to_num after the weights: the picture is finite and wrong, without a message
    lengths = torch.diff(posts(2), dim=-1)
    sigma = torch.ones_like(lengths)
    sigma[1, 7] = math.nan
    w = torch.nan_to_num(running_product(sigma, lengths)[0])
    gap = float((w[1].sum() - w[0].sum()).abs())
    yield check("error of opacity without a message", gap, high=0.0, subject="nan_to_num", owner="usual")


def _pixels(rule: Rule, sigma: Tensor, t: Tensor, t_edges: Tensor) -> Tensor:
    """Return colour, opacity and depth of each ray [rays, 5], without checks."""
    w, T_end = rule.weights(sigma, rule.lengths(t, t_edges))
    ray = torch.arange(len(t)).repeat_interleave(t.shape[1])
    seen = composite(w.flatten(), ray, torch.cos(t).flatten().unsqueeze(-1).expand(-1, 3), T_end, BACKGROUND)
    return torch.cat([seen, w.sum(dim=-1, keepdim=True), expected_depth(w, t, FAR).unsqueeze(-1)], dim=-1)


SAMPLED_BINS = 16
U = torch.tensor([0.0, 0.0, 1e-45, 1e-30, 0.25, 0.5, 1.0 - 2.0**-24, 1.0, 1.0])
"""Random numbers, including 1, which belongs to no bin and which no generator should return."""


def _weights() -> dict[str, tuple[Tensor, int, int]]:
    """Map case → weights, and the first and last bin in which a distance may lie."""
    last = SAMPLED_BINS - 1
    cases = {"all zero": (torch.zeros(SAMPLED_BINS), 0, last)}
    for spike in (0, 7, last):
        for weight in (1e-45, 1e-38, 1e-10, 1.0, 1e10, 1e30, 3e38):
            w = torch.zeros(SAMPLED_BINS)
            w[spike] = weight
            cases[f"{weight:g} in bin {spike}"] = (w, spike, spike)
    for weight in (1e-45, 1e-10, 1.0, 1e30, 3e38):
        cases[f"{weight:g} everywhere"] = (torch.full((SAMPLED_BINS,), weight), 0, last)
    cases["1e-30 to 1e30"] = (10.0 ** torch.linspace(-30, 30, SAMPLED_BINS), 0, last)
    inner = torch.zeros(SAMPLED_BINS)
    inner[3:6] = torch.tensor([1e-10, 0.0, 1.0])
    cases["zero at both ends"] = (inner, 3, 5)
    return cases


def _tried(draw: Callable[[Tensor, Tensor, Tensor], Tensor], anywhere: bool) -> tuple[float, list[str]]:
    """Return by how much `draw` leaves its bins (or, if `anywhere`, the ray) or steps back, and in which cases."""
    t_edges = posts(bins=SAMPLED_BINS)
    worst, wrong = 0.0, []
    for what, (w, first, last) in _weights().items():
        drawn = draw(t_edges, w.unsqueeze(0), U.unsqueeze(0))[0]
        start, end = (0, SAMPLED_BINS - 1) if anywhere else (first, last)
        out = max(float(t_edges[0, start] - drawn.min()), float(drawn.max() - t_edges[0, end + 1]), 0.0)
        back = max(float(-torch.diff(drawn).min()), 0.0)
        gap = max(out, back) if bool(torch.isfinite(drawn).all()) else math.inf
        if gap > 0.0:
            wrong.append(f"{what}: {'not finite' if math.isinf(gap) else f'{gap:.2g}'}")
        worst = max(worst, gap)
    return worst, wrong


def usual_inverse(t_edges: Tensor, w: Tensor, u: Tensor) -> Tensor:
    """Sample as is usual: weights + 1e-5, and the mass of an almost empty bin is replaced by 1."""
    w = w + 1e-5
    cdf = torch.cumsum(w / w.sum(dim=-1, keepdim=True), dim=-1)
    cdf = torch.cat([torch.zeros_like(cdf[:, :1]), cdf], dim=-1)
    right = torch.searchsorted(cdf, u.contiguous(), right=True)
    below, above = (right - 1).clamp(min=0), right.clamp(max=cdf.shape[-1] - 1)
    left, mass = cdf.gather(-1, below), cdf.gather(-1, above) - cdf.gather(-1, below)
    share = (u - left) / torch.where(mass < 1e-5, torch.ones_like(mass), mass)
    return t_edges.gather(-1, below) + share * (t_edges.gather(-1, above) - t_edges.gather(-1, below))


def inverse_cdf_extremes(context: StabilityContext) -> Iterator[Found]:
    worst, wrong = _tried(inverse_cdf, anywhere=False)
    what = "largest distance outside the bins with weight, or backwards"
    yield check(what, worst, high=0.0, why="; ".join(wrong[:4]), subject="inverse_cdf")
    accepted = []
    for bad, kind in ((math.nan, FloatingPointError), (math.inf, FloatingPointError), (-1e-6, ValueError)):
        w = torch.ones(3, SAMPLED_BINS)
        w[1, 4] = bad
        error = error_of(kind, inverse_cdf, posts(3, SAMPLED_BINS), w, U.expand(3, -1))
        if error is None or "bin 4 on ray 1" not in str(error):
            accepted.append(f"{bad}: {error or 'accepted'}")
    yield none_of("bad weights accepted or misnamed", accepted, "inverse_cdf")
    count = 0
    for w, _, _ in _weights().values():  # distances are differentiable in the fenceposts only
        t_edges = posts(bins=SAMPLED_BINS).requires_grad_()
        inverse_cdf(t_edges, w.unsqueeze(0).requires_grad_(), U.unsqueeze(0)).sum().backward()
        count += int((~torch.isfinite(t_edges.grad)).sum()) if t_edges.grad is not None else t_edges.numel()
    yield check("gradients that are not finite", float(count), high=0.0, subject="inverse_cdf")
    worst, wrong = _tried(usual_inverse, anywhere=True)  # its floor of 1e-5 samples every bin
    why = f"{len(wrong)} of {len(_weights())} distributions: {'; '.join(wrong[:3])}" if wrong else ""
    what, subject = "largest distance outside the ray, or backwards", "weights + 1e-5"
    yield check(what, worst, high=0.0, why=why, subject=subject, owner="usual")
