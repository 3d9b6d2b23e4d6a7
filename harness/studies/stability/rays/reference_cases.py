"""R1: the renderer of this harness against independent renderers and closed forms."""

from collections.abc import Iterator
from typing import NamedTuple

import mpmath
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from baselines.contract import Box, Rays, Rendering
from baselines.marching.sampling_plan import Sampling
from baselines.numerics.bounds import ray_box
from baselines.numerics.quadrature import QUADRATURES
from baselines.numerics.sampling import points_in_bins, uniform_edges
from baselines.rendering import render_rays
from harness.records.study import Table, check
from harness.studies.framework import Found, Rows
from harness.studies.stability.rays.exact_rays import FunctionField, owner_of
from harness.studies.stability.stability_context import StabilityContext, not_judged
from scenes.files.errors import InputError
from scenes.rendering.medium_reference import Differentiated, Estimate, differentiated, tracked
from scenes.rendering.variant import Variant, choose_variant

CELLS = 16
TAU_OF_A_VOXEL = (0.03, 0.3, 5.0)
"""The largest τ of a voxel in three grids: a veil, a cloud and a solid."""
LARGEST_Z = 4.0
LARGEST_ERROR = 1e-3
"""The largest standard error at which agreement is meaningful."""
PATHS = 420_000
RAYS, BINS = 16, 256
"""The rays and bins of the deterministic comparison, in which truncation is the same on both sides."""
FINE_BINS = 4096
"""The bins of the comparison with the integral."""
VALUE_BAR, SIGMA_BAR, COLOUR_BAR = 5e-6, 5e-6, 1e-4
CLOSED_FORM_BAR, FIRST_ORDER_BAR = 1e-6, 5e-4
SCALAR = Variant("scalar_rgb", None, "always there")
ORIGIN = np.array([-1.0, 0.3, 0.4])
DIRECTION = np.array([1.8, 0.4, 0.2]) / np.linalg.norm([1.8, 0.4, 0.2])


def _trilinear(
    values: Float[Tensor, "channels z y x"], x: Float[Tensor, "points 3"]
) -> Float[Tensor, "points channels"]:
    places = (2.0 * x - 1.0).reshape(1, -1, 1, 1, 3)
    sampled = torch.nn.functional.grid_sample(values.unsqueeze(0), places, align_corners=False, padding_mode="border")
    return sampled.reshape(len(values), -1).T


def random_grids(tau_of_a_voxel: float) -> tuple[np.ndarray, np.ndarray]:
    """Return density [z, y, x] and colour [z, y, x, 3] of a random pattern that is the same for every τ."""
    generator = np.random.default_rng(16)
    pattern, colour = generator.random((CELLS,) * 3), generator.random((*(CELLS,) * 3, 3))
    return pattern * CELLS * tau_of_a_voxel, colour


def field_of(sigma: Tensor, colour: Tensor) -> FunctionField:
    return FunctionField(
        lambda x: _trilinear(sigma.unsqueeze(0), x)[:, 0], lambda x: _trilinear(colour.permute(3, 0, 1, 2), x)
    )


def rendered(
    sigma: np.ndarray,
    colour: np.ndarray,
    bins: int,
    quadrature: str = "midpoint",
    origin: np.ndarray = ORIGIN,
    direction: np.ndarray = DIRECTION,
) -> Rendering:
    box = Box(torch.zeros(3, dtype=torch.float64), torch.ones(3, dtype=torch.float64))
    ray = Rays(torch.as_tensor(origin[None]), torch.as_tensor(direction[None]), 0.0, 10.0)
    field, sampling = field_of(torch.as_tensor(sigma), torch.as_tensor(colour)), Sampling(bins, quadrature=quadrature)
    return render_rays(field, None, ray, box, sampling, None, torch.zeros(3, dtype=torch.float64), None)


# (1) Mitsuba's own path tracer


def z_scores(colour: np.ndarray, estimate: Estimate) -> np.ndarray:
    z: np.ndarray = (colour - estimate.mean) / estimate.standard_error
    return z


def _against_tracking(variant: Variant, paths: int) -> Iterator[Found]:
    rows: Rows = []
    worst = dict.fromkeys(QUADRATURES, 0.0)
    largest_error = 0.0
    for tau in TAU_OF_A_VOXEL:
        sigma, colour = random_grids(tau)
        estimate = tracked(sigma, colour, ORIGIN, DIRECTION, paths, variant)
        largest_error = max(largest_error, float(estimate.standard_error.max()))
        for rule in worst:
            ours = rendered(sigma, colour, FINE_BINS, rule).colour[0].numpy()
            z = z_scores(ours, estimate)
            worst[rule] = max(worst[rule], float(np.abs(z).max()))
            for channel, name in enumerate(("red", "green", "blue")):
                figures = (ours, estimate.mean, estimate.standard_error, z)
                rows.append([f"τ of a voxel ≤ {tau:g}, {name}", rule, *(float(figure[channel]) for figure in figures)])
    columns = ["ray", "rule", "this renderer", "volpath", "standard error", "z"]
    title = f"One ray through three random grids: {FINE_BINS} bins against {estimate.paths} paths, {variant.name}"
    yield Table(f"reference.tracking.{variant.name}", 12, title, columns, rows)
    what, subject = "largest standard error of volpath's estimates", f"{variant.name}, noise"
    yield check(what, largest_error, high=LARGEST_ERROR, subject=subject)
    for rule, largest in worst.items():
        what = f"largest |z| against volpath, {variant.name}, three grids × three channels"
        yield check(what, largest, high=LARGEST_Z, subject=f"{rule}, {variant.name}", owner=owner_of(rule))


# (2) Dr.Jit on Mitsuba's volumes


class Bundle(NamedTuple):
    """Points along rays, and the weights of their colours in the sum that is differentiated."""

    points: Float[Tensor, "rays bins 3"]
    t: Float[Tensor, "rays bins"]
    edges: Float[Tensor, "rays edges"]
    weights: Float[Tensor, "rays 3"]


def bundle() -> Bundle:
    """Return rays into the cube from all sides, with points at the midpoints of equal bins, float64."""
    generator = torch.Generator().manual_seed(4)
    around = torch.randn(RAYS, 3, generator=generator, dtype=torch.float64)
    origins = 0.5 + 1.5 * torch.nn.functional.normalize(around, dim=-1)
    aims = 0.5 + 0.3 * (torch.rand(RAYS, 3, generator=generator, dtype=torch.float64) - 0.5)
    directions = torch.nn.functional.normalize(aims - origins, dim=-1)
    lower, upper = torch.zeros(3, dtype=torch.float64), torch.ones(3, dtype=torch.float64)
    entry, leave, _ = ray_box(origins, directions, lower, upper, 0.0, 10.0)
    edges = uniform_edges(entry, leave, BINS)
    t = points_in_bins(edges, None)
    points = origins[:, None] + t[..., None] * directions[:, None]
    return Bundle(points, t, edges, torch.randn(RAYS, 3, generator=generator, dtype=torch.float64))


def by_autograd(sigma: np.ndarray, colour: np.ndarray, some: Bundle, rule: str = "midpoint") -> Differentiated:
    density, hue = (torch.as_tensor(values).requires_grad_() for values in (sigma, colour))
    field, flat = field_of(density, hue), some.points.reshape(-1, 3)
    w, _ = QUADRATURES[rule](field.density(flat).reshape(some.t.shape), some.t, some.edges)
    seen = (w.unsqueeze(-1) * field.colour(flat).reshape(*some.t.shape, 3)).sum(dim=1)
    d_sigma, d_colour = torch.autograd.grad((seen * some.weights).sum(), (density, hue))
    return Differentiated(seen.detach().numpy(), d_sigma.numpy(), d_colour.numpy())


def errors(theirs: Differentiated, ours: Differentiated) -> tuple[float, float, float]:
    """Return the absolute error of colour, and the relative errors of both gradients in the Euclidean norm."""
    return (
        float(np.abs(theirs.colour - ours.colour).max()),
        float(np.linalg.norm(theirs.d_sigma - ours.d_sigma) / np.linalg.norm(ours.d_sigma)),
        float(np.linalg.norm(theirs.d_colour - ours.d_colour) / np.linalg.norm(ours.d_colour)),
    )


def _against_gridvolume(variant: Variant) -> Iterator[Found]:
    some = bundle()
    delta = torch.diff(some.edges, dim=-1).numpy()
    worst = {"midpoint": [0.0] * 3, "listing4": [0.0] * 3}
    for tau in TAU_OF_A_VOXEL:
        sigma, colour = random_grids(tau)
        theirs = differentiated(sigma, colour, some.points.numpy(), delta, some.weights.numpy(), variant)
        for rule, so_far in worst.items():
            worst[rule] = list(map(max, so_far, errors(theirs, by_autograd(sigma, colour, some, rule))))
    bars = (
        ("values", VALUE_BAR, "largest difference of a colour"),
        ("∂σ", SIGMA_BAR, "relative difference of the gradient in σ"),
        ("∂c", COLOUR_BAR, "relative difference of the gradient in colour"),
    )
    for rule, figures in worst.items():
        for figure, (name, bar, what) in zip(figures, bars, strict=True):
            yield check(what, figure, high=bar, subject=f"{rule}, gridvolume {name}", owner=owner_of(rule))


# (3) closed forms


def layered() -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(3)
    return 5.0 + 20.0 * generator.random(CELLS), generator.random(CELLS)


def closed_form(sigma: np.ndarray, grey: np.ndarray) -> tuple[float, float]:
    """Return colour and opacity through layers that are linear between cell centres and flat at both ends."""
    with mpmath.workdps(40):
        cells = len(sigma)
        ends = [mpmath.mpf(0), *(mpmath.mpf(2 * i + 1) / (2 * cells) for i in range(cells)), mpmath.mpf(1)]
        at_ends = [[mpmath.mpf(float(v)) for v in (values[0], *values, values[-1])] for values in (sigma, grey)]
        passed, colour = mpmath.mpf(0), mpmath.mpf(0)
        for i in range(cells + 1):
            width = ends[i + 1] - ends[i]
            sigmas, greys = (values[i : i + 2] for values in at_ends)
            colour += _light_of_a_piece(width, sigmas, greys, passed)
            passed += width * (sigmas[0] + sigmas[1]) / 2
        return float(colour), float(-mpmath.expm1(-passed))


def _light_of_a_piece(
    width: mpmath.mpf, sigmas: list[mpmath.mpf], greys: list[mpmath.mpf], passed: mpmath.mpf
) -> mpmath.mpf:
    (s0, s1), (c0, c1) = sigmas, greys

    def glow(u: mpmath.mpf) -> mpmath.mpf:
        tau = passed + width * (s0 * u + (s1 - s0) * u * u / 2)
        return mpmath.exp(-tau) * (s0 + (s1 - s0) * u) * (c0 + (c1 - c0) * u) * width

    return mpmath.quad(glow, [0, 1])


def _against_closed_forms() -> Iterator[Found]:
    sigma, grey = layered()
    colour, opacity = closed_form(sigma, grey)
    shape = (CELLS,) * 3
    grids = np.broadcast_to(sigma, shape).copy(), np.broadcast_to(grey[:, None], (*shape, 3)).copy()
    for rule, quadrature in QUADRATURES.items():
        seen = rendered(*grids, FINE_BINS, rule, np.array([-1.0, 0.37, 0.61]), np.array([1.0, 0.0, 0.0]))
        gap = max(abs(float(seen.colour[0, 0]) - colour), abs(float(seen.opacity[0]) - opacity))
        bar, why = CLOSED_FORM_BAR, ""
        if quadrature.orders.colour == 1.0:
            bar = FIRST_ORDER_BAR
            why = f"fails the {CLOSED_FORM_BAR:g} of the others: a rule of first order would need about 1e6 bins"
        what = "largest error of colour and opacity through layers, mpmath"
        yield check(what, gap, high=bar, why=why, subject=f"{rule}, closed form", owner=owner_of(rule))


def independent(context: StabilityContext) -> Iterator[Found]:
    paths = 1600 if context.quick else PATHS
    yield from _against_tracking(SCALAR, paths)
    try:
        fast = choose_variant("llvm_ad_rgb")
    except InputError as error:
        for subject in ("midpoint, llvm_ad_rgb", "midpoint, gridvolume"):
            yield not_judged(subject, str(error), "not_available")
    else:
        yield from _against_tracking(fast, paths)
        yield from _against_gridvolume(fast)
    yield from _against_closed_forms()
