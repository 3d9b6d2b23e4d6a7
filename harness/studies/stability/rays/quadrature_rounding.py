"""Q1 and Q3: the rounding error of a ray's colour and gradient, without the truncation error of the rule."""

import math
from collections.abc import Callable, Iterator
from functools import cache

import mpmath
import torch
from torch import Tensor

from baselines.numerics.quadrature import QUADRATURES
from harness.records.study import Check, Owner, Series, check
from harness.studies.framework import Found
from harness.studies.stability.rays.exact_rays import DIGITS, OURS, colour, weights_in_digits
from harness.studies.stability.rays.usual_quadrature import depths, running_product, stock_expm1
from harness.studies.stability.stability_context import StabilityContext, error_of, worst_of

SHADE = 0.75
"""The colour of the homogeneous ray, exact in every precision."""
BAR, GRADIENT_BAR, DOUBLE_BAR = 1e-6, 5e-6, 1e-9
LEAST = 1e-17
"""The value at which an error of 0 is drawn: the axis has no 0."""
DTYPES = {"float64": torch.float64, "float32": torch.float32, "float16": torch.float16, "bfloat16": torch.bfloat16}
EXPONENTS = [k / 2 for k in range(-16, 17)]
BIN_DEPTHS = [1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0, 2.0, 4.0, 8.0, 15.6, 30.0, 62.0, 100.0]

Weights = Callable[[Tensor, Tensor], tuple[Tensor, Tensor]]
"""Densities and lengths of bins → weights and T_end."""


def running_sum(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    tau, before, T_end = depths(sigma, lengths)
    return torch.exp(-before) * (1.0 - torch.exp(-tau)), T_end


def log_space(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    tau, before, T_end = depths(sigma, lengths)
    return torch.exp(-before + torch.log(-torch.expm1(-tau))), T_end


def _printed(sigma: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Evaluate Listing 4, whose last interval is 1e10."""
    endless = torch.cat([lengths[:, :-1], torch.full_like(lengths[:, :1], 1e10)], dim=-1)
    return QUADRATURES["listing4"].weights(sigma, endless)


OTHERS: dict[str, tuple[Owner, Weights]] = {
    "running product": ("usual", running_product),
    "running sum of 1 − exp": ("usual", running_sum),
    "listing4": ("paper", _printed),
}
OTHER_GRADIENTS: dict[str, tuple[Owner, Weights]] = {
    "autograd through expm1": ("usual", stock_expm1),
    "running product": ("usual", running_product),
    "log space": ("usual", log_space),
    "listing4": ("paper", _printed),
}


def homogeneous(context: StabilityContext) -> Iterator[Found]:
    counts = (1, 64) if context.quick else (1, 64, 10**6)
    exponents = EXPONENTS[::8] if context.quick else EXPONENTS
    what = "largest relative error of colour, opacity and transmittance, float32"
    relative = "transmittance relative to max(1, τ), by which rounding τ itself changes it"
    for name in OURS:
        worst = max(
            error
            for bins in counts
            for k in (exponents if bins < 1000 else [-8, -4, 0, 0.5, 1, 2, 8])
            for error in _errors(QUADRATURES[name].weights, name, 10.0**k, bins)
        )
        yield check(what, worst, high=BAR, why=relative, subject=name)
        half = [_ray(name, 1.0, 4, dtype)[:2] for dtype in (torch.float16, torch.bfloat16)]
        accepted = sum(error_of(TypeError, QUADRATURES[name].weights, *ray) is None for ray in half)
        yield check("half precisions that are not refused", float(accepted), high=0.0, subject=name)
    for name, (owner, weights) in OTHERS.items():
        errors = {k: worst_of(_errors(weights, "midpoint", 10.0**k, 64)) for k in exponents}
        lost = max((k for k, error in errors.items() if error > 0.01), default=None)
        why = "" if lost is None else f"over 1 % wrong up to τ = {10.0**lost:.1g}"
        yield check(f"{what}, 64 bins", worst_of(errors.values()), high=BAR, why=why, subject=name, owner=owner)
    yield from _error_against_depth(exponents)
    if not context.quick:
        bins = [4**k for k in range(2, 10)] + [10**6]
        panel = "Drift over many bins, τ = 5, float32"
        drifting = {"ours (midpoint)": QUADRATURES["midpoint"].weights, "running product": running_product}
        for name, weights in drifting.items():
            y = [max(_errors(weights, "midpoint", 5.0, count)[2] * 5.0, LEAST) for count in bins]
            yield Series(panel, 1, name, "bins", "relative error of transmittance", [float(count) for count in bins], y)


@cache
def _ray(rule: str, tau: float, bins: int, dtype: torch.dtype) -> tuple[Tensor, Tensor, float, float]:
    """Return densities, lengths, and the exact opacity and transmittance of these rounded numbers. With one density
    everywhere the sum of every rule telescopes: its optical depth is σ times the summed lengths.
    """
    t_edges = torch.linspace(0.0, 1.0, bins + 1, dtype=torch.float64).to(dtype).unsqueeze(0)
    t, _ = QUADRATURES[rule].place(t_edges, None)
    sigma, lengths = torch.full_like(t, tau), torch.diff(t_edges, dim=-1)
    with mpmath.workdps(DIGITS):
        depth = mpmath.mpf(float(sigma[0, 0])) * mpmath.mpf(math.fsum(lengths[0].double().tolist()))
        return sigma, lengths, float(-mpmath.expm1(-depth)), float(mpmath.exp(-depth))


def _errors(
    weights: Weights, rule: str, tau: float, bins: int, dtype: torch.dtype = torch.float32
) -> tuple[float, float, float]:
    """Return relative errors of colour, opacity and transmittance; infinite if a number is not finite."""
    sigma, lengths, opacity, transmittance = _ray(rule, tau, bins, dtype)
    w, T_end = weights(sigma, lengths)
    seen, total = float((w * SHADE).sum()), float(w.sum())
    T_error = abs(float(T_end) - transmittance)
    # below the smallest normal number of the precision no digits can be lost
    tiny = torch.finfo(dtype).tiny
    T_error = 0.0 if T_error < tiny else T_error / max(transmittance, tiny) / max(1.0, tau)
    errors = (abs(seen / (SHADE * opacity) - 1.0), abs(total / opacity - 1.0), T_error)
    return errors if all(map(math.isfinite, errors)) else (math.inf,) * 3


def _error_against_depth(exponents: list[float]) -> Iterator[Series]:
    panel = "Rounding, 64 bins, homogeneous ray"
    others = {"Listing 4 with its interval of 1e10" if name == "listing4" else name: form[1]
              for name, form in OTHERS.items()}  # fmt: skip
    # the rules of this harness refuse half precision: only other forms have lines in it
    lines: list[tuple[str, str, str, Weights, str]] = [
        *((panel, f"ours ({name}), {dtype}", name, QUADRATURES[name].weights, dtype)
          for name in OURS for dtype in ("float64", "float32")),
        *((panel, f"{name}, float32", "midpoint", weights, "float32") for name, weights in others.items()),
        *((f"{panel}: others by precision", f"{name}, {dtype}", "midpoint", others[name], dtype)
          for name in others for dtype in DTYPES),
    ]  # fmt: skip
    for panel, name, rule, weights, dtype in lines:
        numbers = torch.finfo(DTYPES[dtype])
        normal = (10.0**k for k in exponents if numbers.tiny <= 10.0**k <= numbers.max)
        points = {tau: _errors(weights, rule, tau, 64, DTYPES[dtype])[0] for tau in normal}
        yield from _line(panel, 1, name, "optical depth of the ray", "relative error of colour", points)


def _line(panel: str, item: int, name: str, x_label: str, y_label: str, points: dict[float, float]) -> Iterator[Series]:
    shown = {x: max(y, LEAST) for x, y in points.items() if math.isfinite(y)}
    if shown:
        yield Series(panel, item, name, x_label, y_label, list(shown), list(shown.values()))


RAMP, HOLE = "ramp", "one density, none at one point"
SHAPES: dict[str, Callable[[Tensor], Tensor]] = {
    "one density": torch.ones_like,
    RAMP: lambda t: 0.5 + t,
    HOLE: lambda t: (torch.arange(t.shape[1]) != t.shape[1] // 2).to(t.dtype).expand_as(t),
}


def gradients(context: StabilityContext) -> Iterator[Found]:
    depths = BIN_DEPTHS[::7] if context.quick else BIN_DEPTHS
    bins = 2 if context.quick else 8
    what = "error of ∂C/∂σ over its largest entry"
    axes = ("optical depth of a bin", "error over the largest entry")
    for name in OURS:
        weights = QUADRATURES[name].weights
        for dtype, bar in (("float32", GRADIENT_BAR), ("float64", DOUBLE_BAR)):
            errors = {tau: _gradient_error(weights, name, tau, bins, DTYPES[dtype]) for tau in depths}
            on_ramp = [_gradient_error(weights, name, tau, bins, DTYPES[dtype], RAMP) for tau in depths]
            worst, worst_on_ramp = worst_of(errors.values()), worst_of(on_ramp)
            why = f"one density {worst:.2g}, ramp {worst_on_ramp:.2g}"
            yield check(f"{what}, {dtype}", worst_of([worst, worst_on_ramp]), high=bar, why=why, subject=name)
            if name in ("midpoint", "linear"):
                yield from _line("Gradients", 3, f"ours ({name}), {dtype}", *axes, errors)
        yield _gradcheck(name)
    for name, (owner, weights) in OTHER_GRADIENTS.items():
        errors = {tau: _gradient_error(weights, "midpoint", tau, bins, torch.float32) for tau in depths}
        empty = _gradient_error(weights, "midpoint", 1.0, bins, torch.float32, HOLE)
        wrong = [f"{tau:g}" for tau, error in errors.items() if not error <= 1.0]
        whys = [] if math.isfinite(empty) else [f"{empty} where one density is 0"]
        whys += [f"no digit right at τ of a bin = {', '.join(wrong)}"] if wrong else []
        worst = worst_of([*errors.values(), empty])
        yield check(f"{what}, float32", worst, high=GRADIENT_BAR, why="; ".join(whys), subject=name, owner=owner)
        yield from _line("Gradients", 3, f"{name}, float32", *axes, errors)


def _gradient_error(
    weights: Weights, rule: str, depth: float, bins: int, dtype: torch.dtype, shape: str = "one density"
) -> float:
    """Return the error of ∂C/∂σ over its largest entry, by comparison with 120 digits; 0 if both underflow."""
    t_edges = torch.linspace(0.0, 1.0, bins + 1, dtype=torch.float64).unsqueeze(0)
    t, _ = QUADRATURES[rule].place(t_edges, None)
    sigma = (depth * bins * SHAPES[shape](t)).to(dtype)
    shades = colour(t).to(dtype)
    lengths = torch.full((1, bins), 1.0 / bins, dtype=dtype)
    sigma.requires_grad_()
    (gradient,) = torch.autograd.grad((weights(sigma, lengths)[0] * shades).sum(), sigma)
    if not bool(torch.isfinite(gradient).all()):
        return math.nan
    exact = _exact_gradient(rule, tuple(sigma.detach()[0].tolist()), tuple(shades[0].tolist()), float(lengths[0, 0]))
    largest = max(map(abs, exact))
    if largest < torch.finfo(dtype).tiny / torch.finfo(dtype).eps:
        return 0.0 if float(gradient.abs().max()) <= 2.0 * largest + torch.finfo(dtype).tiny else math.inf
    return float((gradient[0].double() - torch.tensor(exact, dtype=torch.float64)).abs().max()) / largest


@cache
def _exact_gradient(rule: str, sigma: tuple[float, ...], shades: tuple[float, ...], length: float) -> list[float]:
    with mpmath.workdps(120):
        step = mpmath.mpf(10) ** -20
        lengths = [mpmath.mpf(length)] * ((len(sigma) - QUADRATURES[rule].closed) // QUADRATURES[rule].stride)

        def seen(point: int, change: mpmath.mpf) -> mpmath.mpf:
            moved = [mpmath.mpf(value) for value in sigma]
            moved[point] += change
            w = weights_in_digits(rule, moved, lengths)[:-1]
            return sum((weight * mpmath.mpf(shade) for weight, shade in zip(w, shades, strict=True)), mpmath.mpf(0))

        return [float((seen(i, step) - seen(i, -step)) / (2 * step)) for i in range(len(sigma))]


def _gradcheck(name: str) -> Check:
    """Check random sums of weights and transmittance against central differences, in float64."""
    rule = QUADRATURES[name]
    generator = torch.Generator().manual_seed(5)
    t_edges = torch.rand(1, 8, dtype=torch.float64, generator=generator).cumsum(-1)
    t, _ = rule.place(t_edges, None)
    sigma = (0.1 + 3.0 * torch.rand(t.shape, dtype=torch.float64, generator=generator)).requires_grad_()
    upstream = torch.randn(1 + t.shape[1], dtype=torch.float64, generator=generator)

    def seen(densities: Tensor) -> Tensor:
        w, T_end = rule.weights(densities, torch.diff(t_edges).expand(len(densities), -1))
        return torch.cat([w, T_end.unsqueeze(-1)], dim=-1) @ upstream

    (gradient,) = torch.autograd.grad(seen(sigma).sum(), sigma)
    step = 1e-5 * torch.eye(t.shape[1], dtype=torch.float64)
    numeric = (seen(sigma.detach() + step) - seen(sigma.detach() - step)) / 2e-5
    worst = float((gradient[0] - numeric).abs().max())
    return check("difference from central differences, float64", worst, high=DOUBLE_BAR, subject=name)
