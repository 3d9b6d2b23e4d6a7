"""Q1 and Q3: what rounding does to a ray's colour and to its gradient, apart from any error of the rule."""

import math
from collections.abc import Callable, Iterator
from functools import cache

import mpmath
import torch
from torch import Tensor

from baselines.numerics.quadrature import QUADRATURES
from harness.records.study import Check, Owner, Series, check
from harness.studies.stability.rays.exact_rays import DIGITS, colour, weights_in_digits
from harness.studies.stability.stability_context import Finding, StabilityContext


def running_product(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Return w and T_end, in any precision: α = 1 − exp(−σδ), transmittance as a running product of 1 − α + 1e-10."""
    alpha = 1.0 - torch.exp(-sigma * lengths)
    through = torch.cumprod(torch.cat([torch.ones_like(alpha[:, :1]), 1.0 - alpha + 1e-10], dim=-1), dim=-1)
    return alpha * through[:, :-1], through[:, -1]


def running_sum(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Return 1 − exp(−τ) as it stands, with transmittance from a running sum."""
    tau = sigma * lengths
    through = torch.cumsum(tau, dim=-1)
    before = torch.cat([torch.zeros_like(through[:, :1]), through[:, :-1]], dim=-1)
    return torch.exp(-before) * (1.0 - torch.exp(-tau)), torch.exp(-through[:, -1])


def stock_expm1(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Run our own forward pass, differentiated by autograd: the gradient of torch.expm1 is grad · (result + 1)."""
    tau = sigma * lengths
    through = torch.cumsum(tau, dim=-1)
    before = torch.cat([torch.zeros_like(through[:, :1]), through[:, :-1]], dim=-1)
    return torch.exp(-before) * -torch.expm1(-tau), torch.exp(-through[:, -1])


def log_space(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Return w = exp(log T + log(1 − exp(−τ)))."""
    tau = sigma * lengths
    through = torch.cumsum(tau, dim=-1)
    before = torch.cat([torch.zeros_like(through[:, :1]), through[:, :-1]], dim=-1)
    return torch.exp(-before + torch.log(-torch.expm1(-tau))), torch.exp(-through[:, -1])


Weights = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]

OURS = [name for name, rule in QUADRATURES.items() if not rule.of_the_paper]
SHADE = 0.75
"""The colour of the homogeneous ray, a number of every precision."""
BAR, GRADIENT_BAR, DOUBLE_BAR = 1e-6, 5e-6, 1e-9
LEAST = 1e-17
"""The value at which an error of 0 is drawn: the axis has no 0."""
DTYPES = {"float64": torch.float64, "float32": torch.float32, "float16": torch.float16, "bfloat16": torch.bfloat16}

EXPONENTS = [k / 2 for k in range(-16, 17)]
BIN_DEPTHS = [1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0, 2.0, 4.0, 8.0, 15.6, 30.0, 62.0, 100.0]


def homogeneous(situation: StabilityContext) -> Iterator[Finding]:
    """Q1: rounding of a homogeneous ray."""
    counts = (1, 64) if situation.quick else (1, 64, 10**6)
    exponents = EXPONENTS[::8] if situation.quick else EXPONENTS
    for name in OURS:
        worst = max(
            error
            for bins in counts
            for k in (exponents if bins < 1000 else [-8, -4, 0, 0.5, 1, 2, 8])
            for error in _errors(QUADRATURES[name].weights, name, 10.0**k, bins, torch.float32)
        )
        yield check(
            "largest relative error of colour, opacity and transmittance, float32",
            worst,
            high=BAR,
            why="transmittance relative to max(1, τ), by which rounding τ itself changes it",
            subject=name,
        )
        yield _refusal(name)
    others: list[tuple[str, Owner, Weights]] = [
        ("running product", "usual", running_product),
        ("running sum of 1 − exp", "usual", running_sum),
        ("listing4", "paper", _printed),
    ]
    for subject, whose, weights in others:
        errors = {k: max(_errors(weights, "midpoint", 10.0**k, 64, torch.float32)) for k in exponents}
        lost = max((k for k, error in errors.items() if error > 0.01), default=None)
        why = "" if lost is None else f"over 1 % wrong up to τ = {10.0**lost:.1g}"
        yield check(
            "largest relative error of colour, opacity and transmittance, float32, 64 bins",
            max(errors.values()),
            high=BAR,
            why=why,
            subject=subject,
            owner=whose,
        )
    yield from _error_against_depth(exponents)
    if not situation.quick:
        yield from _drift()


def _printed(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Evaluate Listing 4, whose last interval is 1e10 and whose T_end is nothing."""
    endless = torch.cat([lengths[:, :-1], torch.full_like(lengths[:, :1], 1e10)], dim=-1)
    return QUADRATURES["listing4"].weights(sigma, endless)


@cache
def _ray(rule: str, tau: float, bins: int, dtype: torch.dtype) -> tuple[Tensor, Tensor, float, float]:
    """Return densities, lengths, and the opacity and transmittance that these very numbers have.

    With one density everywhere the sum of every rule telescopes: its opacity is that of σ times the summed lengths.
    """
    t_edges = torch.linspace(0.0, 1.0, bins + 1, dtype=torch.float64).to(dtype).unsqueeze(0)
    t, _ = QUADRATURES[rule].place(t_edges, None)
    sigma, lengths = torch.full_like(t, tau), torch.diff(t_edges, dim=-1)
    with mpmath.workdps(DIGITS):
        depth = mpmath.mpf(float(sigma[0, 0])) * mpmath.mpf(math.fsum(lengths[0].double().tolist()))
        return sigma, lengths, float(-mpmath.expm1(-depth)), float(mpmath.exp(-depth))


def _errors(weights: Weights, rule: str, tau: float, bins: int, dtype: torch.dtype) -> tuple[float, float, float]:
    """Return relative errors of colour, opacity and transmittance; infinite if a number is not finite."""
    sigma, lengths, opacity, transmittance = _ray(rule, tau, bins, dtype)
    w, T_end = weights(sigma, lengths)
    seen, total = float((w * SHADE).sum()), float(w.sum())
    T_error = abs(float(T_end) - transmittance)
    # below the smallest normal number of the precision there are no digits to lose
    tiny = torch.finfo(dtype).tiny
    T_error = 0.0 if T_error < tiny else T_error / max(transmittance, tiny) / max(1.0, tau)
    found = (abs(seen / (SHADE * opacity) - 1.0), abs(total / opacity - 1.0), T_error)
    return found if all(map(math.isfinite, found)) else (math.inf,) * 3


def _refusal(name: str) -> Check:
    """Check that half precision raises."""
    accepted = 0
    for dtype in (torch.float16, torch.bfloat16):
        sigma, lengths, _, _ = _ray(name, 1.0, 4, dtype)
        try:
            QUADRATURES[name].weights(sigma, lengths)
            accepted += 1
        except TypeError:
            pass
    return check("half precisions that are not refused", float(accepted), high=0.0, subject=name)


def _error_against_depth(exponents: list[float]) -> Iterator[Series]:
    # half precision is refused by ours: it has lines in the forms of others alone
    ours = [(name, dtype) for name in OURS for dtype in ("float64", "float32")]
    others = {
        "running product": running_product,
        "running sum of 1 − exp": running_sum,
        "Listing 4 with its interval of 1e10": _printed,
    }
    all_rules, each = "Rounding, 64 bins, homogeneous ray", "Rounding, 64 bins, homogeneous ray: others by precision"
    lines: list[tuple[str, str, str, Weights, str]] = [
        *((all_rules, f"ours ({name}), {dtype}", name, QUADRATURES[name].weights, dtype) for name, dtype in ours),
        *((all_rules, f"{name}, float32", "midpoint", weights, "float32") for name, weights in others.items()),
        *((each, f"{name}, {dtype}", "midpoint", others[name], dtype) for name in others for dtype in DTYPES),
    ]
    for panel, name, rule, weights, dtype in lines:
        x, y = [], []
        for k in exponents:
            sigma = torch.tensor(10.0**k, dtype=torch.float64).to(DTYPES[dtype])
            if not (torch.finfo(DTYPES[dtype]).tiny <= float(sigma) < math.inf):
                continue  # the density itself is no number of this precision
            error = _errors(weights, rule, 10.0**k, 64, DTYPES[dtype])[0]
            if math.isfinite(error):
                x.append(10.0**k)
                y.append(max(error, LEAST))
        if not x:
            continue  # no depth at all has a finite colour
        yield Series(panel, 1, name, "optical depth of the ray", "relative error of colour", x, y)


def _drift() -> Iterator[Series]:
    counts = [4**k for k in range(2, 10)] + [10**6]
    for name, weights in (("ours (midpoint)", QUADRATURES["midpoint"].weights), ("running product", running_product)):
        y = [max(_errors(weights, "midpoint", 5.0, bins, torch.float32)[2] * 5.0, LEAST) for bins in counts]
        yield Series(
            "Drift over many bins, τ = 5, float32", 1, name, "bins", "relative error of transmittance",
            [float(bins) for bins in counts], y,
        )  # fmt: skip


def gradients(situation: StabilityContext) -> Iterator[Finding]:
    """Q3: rounding of gradients."""
    depths = BIN_DEPTHS[::7] if situation.quick else BIN_DEPTHS
    bins = 2 if situation.quick else 8
    for name in OURS:
        weights = QUADRATURES[name].weights
        for dtype, bar in (("float32", GRADIENT_BAR), ("float64", DOUBLE_BAR)):
            errors = [_gradient_error(weights, name, depth, bins, DTYPES[dtype]) for depth in depths]
            on_ramp = [_gradient_error(weights, name, depth, bins, DTYPES[dtype], RAMP) for depth in depths]
            yield check(
                f"error of ∂C/∂σ over its largest entry, {dtype}",
                max([*errors, *on_ramp], key=_badness),
                high=bar,
                why=f"one density {max(errors, key=_badness):.2g}, ramp {max(on_ramp, key=_badness):.2g}",
                subject=name,
            )
            if name in ("midpoint", "linear"):
                yield _gradient_line(f"ours ({name}), {dtype}", depths, errors)
        yield _gradcheck(name)
    others: list[tuple[str, Owner, Weights]] = [
        ("autograd through expm1", "usual", stock_expm1),
        ("running product", "usual", running_product),
        ("log space", "usual", log_space),
        ("listing4", "paper", _printed),
    ]
    for subject, whose, weights in others:
        errors = [_gradient_error(weights, "midpoint", depth, bins, torch.float32) for depth in depths]
        empty = _gradient_error(weights, "midpoint", 1.0, bins, torch.float32, HOLE)
        wrong = [depth for depth, error in zip(depths, errors, strict=True) if not error <= 1.0]
        why = f"no digit right at τ of a bin = {', '.join(f'{one:g}' for one in wrong)}" if wrong else ""
        if not math.isfinite(empty):
            why = "; ".join(filter(None, (f"{empty} where one density is 0", why)))
        yield check(
            "error of ∂C/∂σ over its largest entry, float32",
            max([*errors, empty], key=_badness),
            high=GRADIENT_BAR,
            why=why,
            subject=subject,
            owner=whose,
        )
        yield _gradient_line(f"{subject}, float32", depths, errors)


RAMP, HOLE = "ramp", "one density, none at one point"
SHAPES: dict[str, Callable[[Tensor], Tensor]] = {
    "one density": torch.ones_like,
    RAMP: lambda t: 0.5 + t,
    HOLE: lambda t: (torch.arange(t.shape[1]) != t.shape[1] // 2).to(t.dtype).expand_as(t),
}
"""The density along a ray, of mean 1."""


def _badness(error: float) -> float:
    return error if math.isfinite(error) else math.inf


def _gradient_line(name: str, depths: list[float], errors: list[float]) -> Series:
    shown = [(x, max(y, LEAST)) for x, y in zip(depths, errors, strict=True) if math.isfinite(y)]
    return Series(
        "Gradients", 3, name, "optical depth of a bin", "error over the largest entry",
        [x for x, _ in shown], [y for _, y in shown],
    )  # fmt: skip


def _gradient_error(
    weights: Weights, rule: str, depth: float, bins: int, dtype: torch.dtype, shape: str = "one density"
) -> float:
    """Return the error of ∂C/∂σ against 120 digits, over its largest entry; only entries that the precision can hold
    are compared.
    """
    t_edges = torch.linspace(0.0, 1.0, bins + 1, dtype=torch.float64).unsqueeze(0)
    t, _ = QUADRATURES[rule].place(t_edges, None)
    sigma = (depth * bins * SHAPES[shape](t)).to(dtype)
    shades = colour(t).to(dtype)
    lengths = torch.full((1, bins), 1.0 / bins, dtype=dtype)
    sigma.requires_grad_()
    (ours,) = torch.autograd.grad((weights(sigma, lengths)[0] * shades).sum(), sigma)
    if not bool(torch.isfinite(ours).all()):
        return math.nan
    exact = _exact_gradient(rule, tuple(sigma.detach()[0].tolist()), tuple(shades[0].tolist()), float(lengths[0, 0]))
    most = max(map(abs, exact))
    if most < torch.finfo(dtype).tiny / torch.finfo(dtype).eps:
        return 0.0 if float(ours.abs().max()) <= 2.0 * most + torch.finfo(dtype).tiny else math.inf
    return float((ours[0].double() - torch.tensor(exact, dtype=torch.float64)).abs().max()) / most


@cache
def _exact_gradient(rule: str, sigma: tuple[float, ...], shades: tuple[float, ...], length: float) -> list[float]:
    """Return the gradient by central differences in 120 digits, of the sum and not of any formula for its
    derivative.
    """
    with mpmath.workdps(120):
        step = mpmath.mpf(10) ** -20
        lengths = [mpmath.mpf(length)] * ((len(sigma) - QUADRATURES[rule].closed) // QUADRATURES[rule].stride)

        def seen(point: int, change: mpmath.mpf) -> mpmath.mpf:
            moved = [mpmath.mpf(one) for one in sigma]
            moved[point] += change
            w = weights_in_digits(rule, moved, lengths)[:-1]
            return sum((one * mpmath.mpf(shade) for one, shade in zip(w, shades, strict=True)), mpmath.mpf(0))

        return [float((seen(i, step) - seen(i, -step)) / (2 * step)) for i in range(len(sigma))]


def _gradcheck(name: str) -> Check:
    """Check with central differences in float64, of random sums of weights and transmittance, as torch's gradcheck
    takes them.
    """
    rule = QUADRATURES[name]
    generator = torch.Generator().manual_seed(5)
    t_edges = torch.rand(1, 8, dtype=torch.float64, generator=generator).cumsum(-1)
    t, _ = rule.place(t_edges, None)
    sigma = (0.1 + 3.0 * torch.rand(t.shape, dtype=torch.float64, generator=generator)).requires_grad_()
    upstream = torch.randn(1 + t.shape[1], dtype=torch.float64, generator=generator)

    def seen(densities: Tensor) -> Tensor:
        w, T_end = rule.weights(densities, torch.diff(t_edges).expand(len(densities), -1))
        return torch.cat([w, T_end.unsqueeze(-1)], dim=-1) @ upstream

    (ours,) = torch.autograd.grad(seen(sigma).sum(), sigma)
    step = 1e-5 * torch.eye(t.shape[1], dtype=torch.float64)
    numeric = (seen(sigma.detach() + step) - seen(sigma.detach() - step)) / 2e-5
    worst = float((ours[0] - numeric).abs().max())
    return check("difference from central differences, float64", worst, high=DOUBLE_BAR, subject=name)
