"""A1, A3, A4, A5, O3: the amplifier at its start, with a NaN, on a solid slab, at extreme inputs; digits by layer."""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import product

import torch
from jaxtyping import Bool
from torch import Tensor, nn

from baselines.amplifiers import AMPLIFIERS, Amplifier
from baselines.catalog import CATALOG
from baselines.composition import Parts
from baselines.contract import DTYPES, Box, Rays
from baselines.field import NetworkField
from baselines.methods.repaired import CANDIDATES
from baselines.numerics.bounds import ray_box
from baselines.numerics.encoding import PHI, encode
from harness.plan.seeds import generator_for
from harness.records.study import Owner, Series, Table, check
from harness.studies.framework import Found, Rows
from harness.studies.stability.fields.small_training import at_an_end, new_trainer, setup, trained, with_parts
from harness.studies.stability.stability_context import (
    PRINTED,
    StabilityContext,
    error_of,
    none_of,
    not_judged,
    owner_of_method,
    worst_of,
)
from harness.training.scoring.metrics import psnr_from_mse
from harness.training.trainer import Diverged, Trainer

OWNERS: dict[str, Owner] = {reading: "paper" if reading in PRINTED else "ours" for reading in AMPLIFIERS}
"""The owner of each reading of the amplifier: this harness for those that the paper does not print."""


def amplifier_with(reading: str, **scalars: float) -> Amplifier:
    """Return a reading with α and β set, as far as they are parameters of it."""
    amplifier = AMPLIFIERS[reading](None)
    with torch.no_grad():
        for name, value in scalars.items():
            if isinstance(weight := getattr(amplifier, name, None), nn.Parameter):
                weight.fill_(value)
    return amplifier


def identity(context: StabilityContext) -> Iterator[Found]:
    generator = generator_for("stability", "A1")
    raws = [spread * torch.randn(4096, generator=generator) for spread in (1.0, 4.0, 16.0)]
    for reading, owner in OWNERS.items():
        if reading.startswith("none"):
            yield not_judged(reading, "nothing that could change a density", owner=owner)
            continue
        with torch.no_grad():
            pairs = [AMPLIFIERS[reading](None).before_and_after(raw) for raw in raws]
        worst = worst_of(float((after - before).abs().max() / before.max()) for before, after in pairs)
        # the paper claims the identity as well, so that its readings have the same threshold
        yield check("largest change of a density, of the densest", worst, high=1.2e-7, subject=reading, owner=owner)


def one_nan(context: StabilityContext) -> Iterator[Found]:
    rays = setup(context).test.all_rays(0)
    bad = len(rays) // 2 + setup(context).test.width // 2
    methods, others = with_parts(context)
    accepted: list[str] = []
    for method in methods:
        trainer = new_trainer(context, method)
        lost = rays_lost(trainer, rays, bad)
        # a NaN that does not reach its own ray is hidden: the number of lost rays does not show that
        count, why = float(lost.sum()) - 1.0, ""
        if not lost[bad]:
            count, why = math.nan, "the NaN is hidden: its own ray is finite"
        what = f"other rays of a chunk of {len(rays)} that are NaN because one sample of one ray is"
        yield check(what, count, high=0, unit="rays", why=why, subject=method, owner=owner_of_method(method))
        accepted += [f"{method}: {what}: {said}" for what, said in misnamed(trainer, rays, bad).items() if said]
    yield from others
    if not methods:
        yield not_judged("harness", "no method of this run is made of parts")
        return
    why = "; ".join(accepted) or f"{len(methods)} methods: both are refused, with the number of the ray"
    what = "NaN rays and samples that were rendered or misnamed"
    yield check(what, len(accepted), high=0, why=why, subject="harness")


@torch.no_grad()
def rays_lost(trainer: Trainer, rays: Rays, bad: int) -> Bool[Tensor, " rays"]:
    """Return which rays of one chunk are not finite when one sample of ray `bad` is not."""
    bins = trainer.settings.bins
    t = torch.linspace(rays.near, rays.far, bins)
    x = (rays.origins.unsqueeze(1) + t.unsqueeze(-1) * rays.directions.unsqueeze(1)).reshape(-1, 3)
    ray = torch.arange(len(rays)).repeat_interleave(bins)
    view = trainer.coarse.encode_directions(rays.directions)
    x[bad * bins] = math.nan
    sigma, _ = trainer.coarse.density_and_colour(x, view, ray)
    return (~torch.isfinite(sigma)).reshape(len(rays), bins).any(dim=-1)


def misnamed(trainer: Trainer, rays: Rays, bad: int) -> dict[str, str]:
    """Return the error messages about a NaN ray and a NaN sample; empty if they name the ray."""
    origins = rays.origins.clone()
    origins[bad, 1] = math.nan
    spoilt = Rays(origins, rays.directions, rays.near, rays.far)
    of_ray = str(error_of(ValueError, trainer.render, spoilt, len(rays)) or "accepted")
    inside = torch.arange(len(rays))
    if trainer.settings.accelerations.clipping and not trainer.whole_rays:
        ends = (trainer.box.lower, trainer.box.upper, rays.near, rays.far)
        inside = torch.nonzero(ray_box(rays.origins, rays.directions, *ends)[2])[:, 0]
    guilty: list[int] = []
    plain = trainer.coarse.density_and_colour

    def with_nan(x: Tensor, view: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
        if not guilty:
            x, middle = x.clone(), int(ray[len(ray) // 2])
            x[torch.nonzero(ray == middle)[:1, 0]] = math.nan
            # where densities depend on the chunk all of them are NaN, and the first ray is named
            guilty.append(int(inside[middle if trainer.field.pointwise else int(ray.min())]))
        seen: tuple[Tensor, Tensor] = plain(x, view, ray)
        return seen

    trainer.coarse.density_and_colour = with_nan
    error = error_of(Diverged, trainer.render, rays, len(rays))
    del trainer.coarse.density_and_colour
    of_sample = error.tensor if error else "accepted"
    return {
        "a NaN ray": "" if f"ray {bad} " in of_ray else of_ray,
        "a NaN sample": "" if of_sample.endswith(f" of ray {guilty[0]}") else of_sample,
    }


SOLID = ("nerf", "qnerf", "qnerf_printed", "qnerf_shifted", "qnerf_theorem", *CANDIDATES)
"""Methods with every reading of the amplifier, in the unit of density of the catalogue."""
RESOLUTIONS = (100, 400, 800)
"""The widths of a view in pixels at which a slab of one pixel must be opaque."""
OPAQUE = 0.99
FOCAL, DISTANCE = 1111.11 / 800.0, 4.0311
"""The classic camera: its focal length per pixel of width, and its distance from the origin in scene units."""
HALF_EXTENT = 1.5
"""Half of the longest side of the box, 1.2 to 1.5 in the classic scenes: in the largest box, a pixel is smallest."""


def pixel_opacity(parts: Parts, resolution: float) -> float:
    """Return the opacity of a slab as thick as a pixel is wide at the origin, at the largest density of a method."""
    box = Box(torch.full((3,), -HALF_EXTENT), torch.full((3,), HALF_EXTENT))
    sigma = largest_density(parts.amplifier) * parts.density_unit(box)
    return -math.expm1(-sigma * DISTANCE / (FOCAL * resolution))


def slab(context: StabilityContext) -> Iterator[Found]:
    """Check the largest opacity that any weights can reach: only the clamp of Listing 2 bounds it, about any mean."""
    panel, drawn = "Largest opacity of a slab one pixel thick", [50.0 * 2 ** (k / 4) for k in range(21)]
    for method in SOLID:
        parts = CATALOG[method].parts
        assert parts is not None
        bounded = AMPLIFIERS[parts.amplifier](None).bounded
        opacity = {resolution: pixel_opacity(parts, resolution) for resolution in RESOLUTIONS}
        worst, owner = min(opacity.values()), "paper" if bounded else owner_of_method(method)
        per = "half box" if parts.density_per == "box" else "scene unit"
        why = f"density is at most {parts.density_scale:.3g} per {per}; " if bounded else "density is not bounded; "
        why += ", ".join(f"{reached:.3g} at {resolution} px" for resolution, reached in opacity.items())
        if worst < OPAQUE:
            why += f"; a black slab on white ends at {psnr_from_mse((1.0 - worst) ** 2):.1f} dB there"
        what = "largest opacity of a slab one pixel thick, the worst of 100, 400 and 800 px"
        yield check(what, worst, low=OPAQUE, why=why, subject=method, owner=owner)
        y = [pixel_opacity(parts, resolution) for resolution in drawn]
        yield Series(panel, 5, method, "pixels across a view", "largest opacity", drawn, y, log_y=False)


@cache
@torch.no_grad()
def largest_density(reading: str) -> float:
    """Return the largest density over raw outputs up to ±1e4, shares of solid points in the chunk, α and β."""
    largest = 0.0
    for solid, empty, share, alpha, beta in product(
        (1.0, 10.0, 1e2, 1e4), (-1e4, 0.0, 1e4), (0.01, 0.5, 1.0), (0.0, 1.0 / PHI, 1.0, 10.0, 1e3), (1.0, 10.0, 1e3)
    ):
        raw = torch.full((100,), empty)
        raw[: round(100 * share)] = solid
        after = amplifier_with(reading, alpha=alpha, beta=beta).before_and_after(raw)[1]
        largest = max(largest, float(after[0]))
    return largest


ALPHAS = (-1.0, 0.0, 1.0 / PHI, 10.0, 1e3, math.inf)
DEAD_BAR = 0.01


def raw_inputs() -> dict[str, Tensor]:
    decades = torch.tensor([0.0, *(sign * 10.0**k for k in range(-45, 31, 3) for sign in (1.0, -1.0))])
    above = torch.nextafter(torch.tensor(0.0), torch.tensor(1.0))
    return {
        "spread": 4.0 * torch.randn(512, generator=generator_for("stability", "A5")),
        "sixty decades": decades,
        "±1e4": torch.tensor([1e4, -1e4, 1e4, -1e4]),
        "all equal": torch.full((64,), 0.25),
        "σ = 0.5 ± ulp": torch.cat([torch.zeros(8), above.repeat(8), torch.tensor([1.2e-7, -1.2e-7])]),
    }


def extremes(context: StabilityContext) -> Iterator[Found]:
    rows: Rows = []
    for reading, owner in OWNERS.items():
        has_alpha = isinstance(getattr(AMPLIFIERS[reading](None), "alpha", None), nn.Parameter)
        bad: list[str] = []
        for alpha in ALPHAS if has_alpha else (1.0,):
            outcomes = {name: at_inputs(reading, alpha, raw) for name, raw in raw_inputs().items()}
            bad += [f"{name} at α = {alpha:g}" for name, (finite, _, _) in outcomes.items() if not finite]
            _, dead, inverted = outcomes["spread"]
            rows.append([reading, f"{alpha:g}" if has_alpha else None, dead, "inverted" if inverted else "kept"])
        yield none_of("inputs whose output or gradient is not finite", bad, reading, owner)
    title = "Raw densities of standard deviation 4: share without a gradient, order of densities"
    yield Table("amplifier-extremes", 6, title, ["amplifier", "α", "dead share", "order"], rows)
    what, jump = "jump of density over the threshold of β = 2, within 2e-7 of raw density", jump_at_threshold(2.0)
    why = "a step of the density field, at which the boost has no gradient"
    yield check(what, jump, high=1e-6, why=why, subject="listing2, threshold", owner="paper")
    for method in ("nerf", "qnerf", "qnerf_theorem", "qnerf_listing4", "qnerf_repaired"):
        if method in context.methods:
            yield from _dead_over_training(context, method)


def at_inputs(reading: str, alpha: float, raw: Tensor) -> tuple[bool, float, bool]:
    amplifier = amplifier_with(reading, alpha=alpha)
    raw = raw.clone().requires_grad_()
    before, after = amplifier.before_and_after(raw)
    after.sum().backward()
    gradients = [raw.grad, *(weight.grad for weight in amplifier.parameters())]
    finite = all(bool(torch.isfinite(x).all()) for x in (before, after, *gradients) if x is not None)
    with torch.no_grad():
        dead = float(at_an_end(before, after, 1.0 if amplifier.bounded else math.inf).float().mean())
        inverted = bool(torch.cov(torch.stack([before, after]).double())[0, 1] < 0)
    return finite, dead, inverted


@torch.no_grad()
def jump_at_threshold(beta: float) -> float:
    """Return |σ′(raw just above 0) − σ′(raw = 0)| of Listing 2: sigmoid(0) lies exactly on its threshold."""
    after = amplifier_with("listing2", beta=beta).before_and_after(torch.tensor([0.0, 2e-7]))[1]
    return float((after[1] - after[0]).abs())


def _dead_over_training(context: StabilityContext, method: str) -> Iterator[Found]:
    history = trained(context, method)
    steps, shares = zip(*history.dead, strict=True)
    alpha = history.trainer.amplifier_scalars()["alpha"]
    panel, x = "Points of the box whose density no gradient reaches", [float(step) for step in steps]
    yield Series(panel, 6, method, "step", "share", x, list(shares), log_x=False, log_y=False)
    what = f"share of points without a gradient of density after {steps[-1]} steps"
    # Eq. 4 moves empty space below 0, where no gradient reaches it, about a running mean as well
    owner: Owner = "ours" if alpha is None else "paper"
    why = "" if alpha is None else f"α = {alpha:.3g}"
    yield check(what, shares[-1], high=DEAD_BAR, why=why, subject=f"{method}, trained", owner=owner)


POINTS = 4096
COLOUR_BAR = 0.5 / 255
"""Half a step of an 8-bit picture."""


@torch.no_grad()
def layers(field: NetworkField, position: Tensor, dtype: torch.dtype) -> list[Tensor]:
    """Compute the outputs of each density layer and the raw density in `dtype`, each [points, width]."""
    position = position.to(dtype)
    h, again, outputs = position, None, []
    for index, layer in enumerate([*field.density_net, field.density_head]):
        x = h if again is None else torch.cat([h, again], dim=-1)
        weight, bias = layer.weight.detach().to(dtype), layer.bias.detach().to(dtype)
        h = torch.nn.functional.linear(x, weight, bias)
        h = torch.relu(h) if index < len(field.density_net) else h
        outputs.append(h)
        again = position if index == field.skip else None
    return outputs


def digits(value: Tensor, truth: Tensor) -> float:
    """Return the correct decimal digits: −log10 of the RMS error relative to the RMS of the truth."""
    return float(-torch.log10((value.double() - truth).square().mean().sqrt() / truth.square().mean().sqrt()))


def digits_by_layer(context: StabilityContext) -> Iterator[Found]:
    methods, others = with_parts(context)
    for method in methods:
        field = trained(context, method).trainer.field
        points = torch.rand(256 if context.quick else POINTS, 3, generator=generator_for("stability", "O3"))
        position = encode(field.box.normalised(field.box.from_unit(points)), field.base, field.position_bands)
        truth = layers(field, position, torch.float64)
        panel, x = f"Digits left in {method}, layer by layer", [float(index + 1) for index in range(len(truth))]
        for name, dtype in DTYPES.items():
            left = list(map(digits, layers(field, position, dtype), truth))
            yield Series(panel, 7, name, "layer", "decimal digits", x, left, log_x=False, log_y=False)
        yield from _changes_of_colour(context, method)
    yield from others


def _changes_of_colour(context: StabilityContext, method: str) -> Iterator[Found]:
    source = trained(context, method).trainer
    rays = setup(context).test.all_rays(0)
    exact = source.render(rays, len(rays)).colour
    for precision in ("bfloat16", "float16"):
        twin = new_trainer(context, method, replace(source.settings, precision=precision))
        twin.fields.load_state_dict(source.fields.state_dict())
        twin.step, twin.grid = source.step, source.grid
        apart = twin.render(rays, len(rays)).colour - exact
        what = "root mean square change of a colour (0 … 1) by matrix multiplications in reduced precision"
        rms, why = math.sqrt(float(apart.square().mean())), f"largest {float(apart.abs().max()):.2g}"
        subject, owner = f"{method}, {precision}", owner_of_method(method)
        yield check(what, rms, high=COLOUR_BAR, why=why, subject=subject, owner=owner)
