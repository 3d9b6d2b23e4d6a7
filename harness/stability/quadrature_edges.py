"""Q6 to Q9: rays with almost nothing, with nothing, and with what is no ray."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from baselines.contract import Box, Rays, Rendering
from baselines.numerics.checks import BadDensity, BadInterval
from baselines.numerics.compositing import composite, expected_depth
from baselines.numerics.quadrature import QUADRATURES, Rule
from baselines.rendering import Sampling, render_rays
from harness.stability.situation import Finding, Situation
from harness.stability.usual_formulas import running_product
from harness.stability_record import Outcome, Whose, judged

OURS = {name: rule for name, rule in QUADRATURES.items() if not rule.of_the_paper}
NEAR, FAR, BINS = 2.0, 6.0, 64
BACKGROUND = torch.tensor([0.25, 0.5, 1.0])


@dataclass
class Fog:
    """A field of one colour and any density."""

    density_at: Callable[[Tensor], Tensor]

    pointwise = True

    def encode_directions(self, d: Tensor) -> Tensor:
        return d

    def density(self, x: Tensor) -> Tensor:
        return self.density_at(x)

    def density_before_and_after(self, x: Tensor) -> tuple[Tensor, Tensor]:
        return self.density_at(x), self.density_at(x)

    def density_and_colour(self, x: Tensor, view: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
        return self.density_at(x), torch.full_like(x, 0.75)


def rendered(
    density: Callable[[Tensor], Tensor], rule: str, near: float = NEAR, far: float = FAR, clip: bool = False
) -> Rendering:
    """Five parallel rays through a box; cut to it with `clip`, else from near to far."""
    origins = torch.stack([torch.linspace(-0.5, 0.5, 5), torch.zeros(5), torch.full((5,), 4.0)], dim=-1)
    rays = Rays(origins, torch.tensor([0.0, 0.0, -1.0]).expand(5, 3), near, far)
    box = Box(-torch.ones(3), torch.ones(3))
    sampling = Sampling(BINS, quadrature=rule, clip_to_box=clip)
    return render_rays(Fog(density), None, rays, box, sampling, None, BACKGROUND, None)


def _whose(rule: Rule) -> Whose:
    return "paper" if rule.of_the_paper else "ours"


def posts(rays: int = 1, bins: int = BINS) -> Tensor:
    return torch.linspace(NEAR, FAR, bins + 1).expand(rays, -1).contiguous()


def almost_nothing(situation: Situation) -> Iterator[Finding]:
    """Q6."""
    del situation
    exact = -math.expm1(-1e-8 * (FAR - NEAR))
    for name, rule in QUADRATURES.items():
        opacity = float(rendered(lambda x: torch.full_like(x[:, 0], 1e-8), name).opacity[0])
        spike = {sigma: _steepest(rule, sigma) for sigma in (1e-8, 1e-10, 1e-12)}
        why = f"opacity {opacity:.3g}; ∂opacity/∂σ at most {max(spike.values()):.2g} for σ = 1e-8 to 1e-12"
        error = abs(opacity / exact - 1.0)
        yield judged("Q6", name, _whose(rule), error, 1e-6, what="relative error of opacity", why=why)
        if not rule.of_the_paper:
            yield judged(
                "Q6", name, "ours", max(spike.values()), 1.001 * (FAR - NEAR) / BINS,
                what="largest ∂opacity/∂σ of a sample, at most the length of a bin",
            )  # fmt: skip
    lengths = torch.diff(posts(), dim=-1)
    w, _ = running_product(torch.full_like(lengths, 1e-8), lengths)
    error = abs(float(w.sum()) / exact - 1.0)
    yield judged("Q6", "running product", "usual", error, 1e-6, what="relative error of opacity")


def _steepest(rule: Rule, sigma: float) -> float:
    t, t_edges = rule.place(posts(), None)
    density = torch.full_like(t, sigma).requires_grad_()
    (gradient,) = torch.autograd.grad(rule.weights(density, rule.lengths(t, t_edges))[0].sum(), density)
    return float(gradient.abs().max())


def nothing(situation: Situation) -> Iterator[Finding]:
    """Q7."""
    del situation

    def solid(x: Tensor) -> Tensor:
        return torch.full_like(x[:, 0], 50.0)

    for name, rule in QUADRATURES.items():
        seen = {
            "near = far": (rendered(solid, name, 3.0, 3.0), 3.0),
            "an empty ray": (rendered(_void, name), FAR),
            "a box without depth": (_flat_box(solid, name), FAR),
        }
        figures = {what: _from_nothing(one, far) for what, (one, far) in seen.items()}
        figures["no bins"] = _without_bins(rule)
        worst = max(figures.values(), key=lambda figure: figure if math.isfinite(figure) else math.inf)
        wrong = [f"{what}: {figure:.3g}" for what, figure in figures.items() if figure != 0.0]
        yield judged(
            "Q7", name, _whose(rule), worst, 0.0,
            what="largest distance from opacity 0, colour = background, depth = far",
            why="; ".join(wrong) or f"exact in {len(figures)} situations",
        )  # fmt: skip
    w = torch.zeros(BINS)
    depth = (w * torch.linspace(NEAR, FAR, BINS)).sum() / w.sum()
    disparity = 1.0 / torch.maximum(torch.tensor(1e-10), depth)
    yield judged("Q7", "disparity 1 / max(1e-10, Σwt/Σw)", "usual", float(disparity), 1.0 / FAR,
                 what="disparity of an empty ray, whose depth is far")  # fmt: skip


def _void(x: Tensor) -> Tensor:
    return torch.zeros_like(x[:, 0])


def _flat_box(density: Callable[[Tensor], Tensor], rule: str) -> Rendering:
    """Rays that run beside the box: cut to it, nothing is left of them."""
    rays = Rays(torch.tensor([[5.0, 0.0, 4.0]]), torch.tensor([[0.0, 0.0, -1.0]]), NEAR, FAR)
    box = Box(-torch.ones(3), torch.ones(3))
    return render_rays(Fog(density), None, rays, box, Sampling(BINS, quadrature=rule), None, BACKGROUND, None)


def _from_nothing(one: Rendering, far: float) -> float:
    gaps = [one.opacity.abs().max(), (one.colour - BACKGROUND).abs().max(), (one.depth - far).abs().max()]
    return max((float(gap) for gap in gaps), key=lambda gap: gap if math.isfinite(gap) else math.inf)


def _without_bins(rule: Rule) -> float:
    t, t_edges = rule.place(posts(3)[:, :1], None)
    w, T_end = rule.weights(torch.full_like(t, 50.0), rule.lengths(t, t_edges))
    return float((w.sum(dim=-1).abs() + (T_end - 1.0).abs()).max())


def no_interval(situation: Situation) -> Iterator[Finding]:
    """Q8."""
    del situation
    backwards = {"far < near": (6.0, 2.0), "far = ∞": (2.0, math.inf), "far NaN": (2.0, math.nan)}
    for name, rule in QUADRATURES.items():
        accepted = [what for what, (near, far) in backwards.items() if not _refused(name, near, far)]
        yield judged(
            "Q8", name, "ours", float(len(accepted)), 0.0, what="intervals that the renderer does not refuse",
            why=", ".join(accepted),
        )  # fmt: skip
        t, t_edges = rule.place(posts(8), None)
        mixed = t_edges.clone()
        mixed[5] = mixed[5].flip(-1)
        if rule.of_the_paper:
            lengths = rule.lengths(rule.place(mixed, None)[0], mixed)
            w, _ = rule.weights(torch.ones_like(t), lengths)
            finite = lengths.clamp(max=1.0)
            without = float(rule.weights(torch.ones_like(t), finite)[0][5].sum())
            yield judged(
                "Q8", name, "paper", abs(float(w[5].sum())), 0.0,
                what="opacity of a ray whose distances fall",
                why=f"accepted; {without:.3g} where its last interval is 1 instead of 1e10",
            )  # fmt: skip
            continue
        try:
            rule(torch.ones_like(t), t, mixed)
            named = "accepted"
        except BadInterval as error:
            named = "" if error.ray == 5 else f"names ray {error.ray}, not 5"
        yield judged("Q8", name, "ours", float(bool(named)), 0.0, what="unsorted rays accepted or misnamed", why=named)
    falling = -torch.diff(posts(), dim=-1)
    w, _ = running_product(torch.ones_like(falling), falling)
    yield judged(
        "Q8", "running product", "usual", abs(float(w.sum())), 0.0, what="|opacity| of a ray whose distances fall",
        why=f"opacity {float(w.sum()):.3g}, nothing is said",
    )  # fmt: skip


def _refused(rule: str, near: float, far: float) -> bool:
    try:
        rendered(_void, rule, near, far)
    except BadInterval:
        return True
    return False


def bad_sample(situation: Situation) -> Iterator[Finding]:
    """Q9."""
    del situation
    rays, ray, sample = 16, 11, 7
    for name, rule in OURS.items():
        t, t_edges = rule.place(posts(rays), None)
        sound = 2.0 * torch.rand(t.shape, generator=torch.Generator().manual_seed(9))
        before = _pixels(rule, sound, t, t_edges)
        unnamed, changed = [], 0
        for wrong in (math.nan, math.inf, -1.0):
            sigma = sound.clone()
            sigma[ray, sample] = wrong
            try:
                rule(sigma, t, t_edges)
                unnamed.append(f"{wrong} accepted")
            except BadDensity as error:
                unnamed += [] if (error.ray, error.sample) == (ray, sample) else [f"{wrong} misnamed"]
            if not _renderer_names(name, wrong):
                unnamed.append(f"{wrong} not named by the renderer")
            after = _pixels(rule, sigma, t, t_edges)
            others = torch.arange(rays) != ray
            changed += int((after[others] != before[others]).any(dim=-1).sum())
        yield judged(
            "Q9", name, "ours", float(len(unnamed)), 0.0, what="bad samples accepted or misnamed",
            why="; ".join(unnamed),
        )  # fmt: skip
        yield judged(
            "Q9", name, "ours", float(changed), 0.0, what="other rays with a changed bit, where nobody asks (audit)"
        )  # fmt: skip
    yield _hidden()


def _pixels(rule: Rule, sigma: Tensor, t: Tensor, t_edges: Tensor) -> Tensor:
    """Colour, opacity and depth of each ray, unchecked."""
    w, T_end = rule.weights(sigma, rule.lengths(t, t_edges))
    ray = torch.arange(len(t)).repeat_interleave(t.shape[1])
    seen = composite(w.flatten(), ray, torch.cos(t).flatten().unsqueeze(-1).expand(-1, 3), T_end, BACKGROUND)
    return torch.cat([seen, w.sum(dim=-1, keepdim=True), expected_depth(w, t, FAR).unsqueeze(-1)], dim=-1)


def _renderer_names(rule: str, wrong: float) -> bool:
    """Whether a density that is wrong on the fourth of five rays is refused by that name."""
    try:
        rendered(lambda x: torch.where((x[:, 0] - 0.25).abs() < 1e-3, wrong, 1.0), rule, clip=True)
    except BadDensity as error:
        return error.ray == 3
    return False


def _hidden() -> Outcome:
    """nan_to_num, as it is found behind weights: the picture is finite, wrong, and nobody is told."""
    lengths = torch.diff(posts(2), dim=-1)
    sigma = torch.ones_like(lengths)
    sigma[1, 7] = math.nan
    w = torch.nan_to_num(running_product(sigma, lengths)[0])
    gap = float((w[1].sum() - w[0].sum()).abs())
    return judged("Q9", "nan_to_num", "usual", gap, 0.0, what="error of opacity that nobody is told of")
