"""A1, A3, A4, A5, O3: the amplifier at its start, with a NaN, as a solid slab, at its extremes; digits lost by
layer."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Any

import torch
from jaxtyping import Bool, Int
from torch import Tensor, nn

from baselines.amplifiers import AMPLIFIERS, Amplifier
from baselines.composition import DENSITY_SCALE
from baselines.contract import Rays
from baselines.field import NetworkField
from baselines.numerics.bounds import ray_box
from baselines.numerics.encoding import PHI, encode
from harness.plan.seeds import generator_for
from harness.records.json_record import finite_or_none
from harness.records.study import Check, Owner, Series, Table, check
from harness.studies.stability.fields.small_training import at_an_end, new_trainer, not_made_of_parts, setup, trained
from harness.studies.stability.stability_context import PRINTED, Finding, StabilityContext, whose
from harness.training.metrics import psnr_from_mse
from harness.training.trainer import Diverged, Trainer

WHOSE: dict[str, Owner] = {reading: "paper" if reading in PRINTED else "ours" for reading in AMPLIFIERS}
"""The owner of each reading of the amplifier; what is not printed anywhere is ours."""


def amplifier_with(reading: str, **scalars: float) -> Amplifier:
    """Return a reading with α and β set; those that it does not have, or that follow from others, are left out."""
    amplifier = AMPLIFIERS[reading]()
    with torch.no_grad():
        for name, value in scalars.items():
            if isinstance(weight := getattr(amplifier, name, None), nn.Parameter):
                weight.fill_(value)
    return amplifier


# A1


def identity(situation: StabilityContext) -> Iterator[Finding]:
    """A1: at α = 1/φ and β = 1 the density that is rendered is the one that came in."""
    del situation
    generator = generator_for("stability", "A1")
    raws = [spread * torch.randn(4096, generator=generator) for spread in (1.0, 4.0, 16.0)]
    for reading in AMPLIFIERS:
        if reading.startswith("none"):
            yield Check(
                "",
                None,
                why="nothing that could change a density",
                subject=reading,
                owner=WHOSE[reading],
                status="not_applicable",
            )
            continue
        amplifier = AMPLIFIERS[reading]()
        worst = 0.0
        with torch.no_grad():
            for raw in raws:
                before, after = amplifier.before_and_after(raw)
                worst = max(worst, float((after - before).abs().max() / before.max()))
        # an identity is what the paper claims as well: it holds or it does not, whoever says so
        yield check(
            "largest change of a density, of the densest", worst, high=1.2e-7, subject=reading, owner=WHOSE[reading]
        )


# A3


class Spoilt:
    """A field whose first sample of one ray is not a number (`baselines.contract.RadianceField`)."""

    def __init__(self, field: NetworkField, ray: int) -> None:
        self.field = field
        self.ray = ray

    def __getattr__(self, name: str) -> Any:
        return getattr(self.field, name)

    def density_and_colour(self, x: Tensor, view: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
        x = x.clone()
        x[torch.nonzero(ray == self.ray)[:1, 0]] = math.nan
        return self.field.density_and_colour(x, view, ray)


def one_nan(situation: StabilityContext) -> Iterator[Finding]:
    """A3: one ray that is NaN, and one sample of one ray that is NaN, in a chunk with a complete view."""
    rays = setup(situation).test.all_rays(0)
    bad = len(rays) // 2 + setup(situation).test.width // 2
    accepted: list[str] = []
    tried = 0
    for method in situation.methods:
        if reason := not_made_of_parts(method):
            yield Check("", None, why=reason, subject=method, owner=whose(method), status="not_applicable")
            continue
        trainer = new_trainer(situation, method)
        lost = rays_lost(trainer, rays, bad)
        others = int(lost.sum()) - int(lost[bad])
        # a NaN that does not reach its own ray is hidden, which no number of rays that are lost shows
        yield check(
            f"other rays of a call of {len(rays)} that are NaN because one sample of one ray is",
            others if bool(lost[bad]) else math.nan,
            high=0,
            unit="rays",
            why="" if bool(lost[bad]) else "the NaN is hidden: its own ray is finite",
            subject=method,
            owner=whose(method),
        )
        tried += 1
        accepted += [f"{method}: {what}: {said}" for what, said in misnamed(trainer, rays, bad).items() if said]
    if not tried:
        yield Check("", None, why="no method of this run is made of parts", subject="harness", status="not_applicable")
        return
    yield check(
        "NaN rays and samples that were rendered or misnamed",
        len(accepted),
        high=0,
        why="; ".join(accepted) or f"{tried} methods: both are refused by the number of the ray",
        subject="harness",
    )


@torch.no_grad()
def rays_lost(trainer: Trainer, rays: Rays, bad: int) -> Bool[Tensor, " rays"]:
    """Return which rays are not finite when one sample of ray `bad` is not, all in one chunk."""
    bins = trainer.settings.bins
    t = torch.linspace(rays.near, rays.far, bins)
    x = (rays.origins.unsqueeze(1) + t.unsqueeze(-1) * rays.directions.unsqueeze(1)).reshape(-1, 3)
    ray = torch.arange(len(rays)).repeat_interleave(bins)
    view = trainer.coarse.encode_directions(rays.directions)
    sigma, _ = Spoilt(trainer.coarse, bad).density_and_colour(x, view, ray)
    return (~torch.isfinite(sigma)).reshape(len(rays), bins).any(dim=-1)


def misnamed(trainer: Trainer, rays: Rays, bad: int) -> dict[str, str]:
    """Return the messages about a NaN ray and a NaN sample that do not name the number of the ray."""
    origins = rays.origins.clone()
    origins[bad, 1] = math.nan
    said = {"a NaN ray": "accepted", "a NaN sample": "accepted"}
    try:
        trainer.render(Rays(origins, rays.directions, rays.near, rays.far), len(rays))
    except ValueError as error:
        said["a NaN ray"] = "" if f"ray {bad} " in str(error) else str(error)
    inside = rays_in_the_call(trainer, rays)
    nth = len(inside) // 2
    # where densities depend on the call every one of them is NaN, and the first is as guilty as any
    expected = int(inside[nth if trainer.field.pointwise else 0])
    first = trainer.coarse
    trainer.coarse = Spoilt(first, nth)
    try:
        trainer.render(rays, len(rays))
    except Diverged as error:
        said["a NaN sample"] = "" if error.tensor.endswith(f" of ray {expected}") else error.tensor
    finally:
        trainer.coarse = first
    return said


def rays_in_the_call(trainer: Trainer, rays: Rays) -> Int[Tensor, " hits"]:
    """Return the numbers of the rays that a field sees: rays that miss the box are not evaluated, and it counts the
    others alone.
    """
    if trainer.whole_rays or not trainer.settings.accelerations.clipping:
        return torch.arange(len(rays))
    box = trainer.box
    return torch.nonzero(ray_box(rays.origins, rays.directions, box.lower, box.upper, rays.near, rays.far)[2])[:, 0]


# A4

SCALES = [10.0**k for k in range(-2, 3)]
DENSE_SCALES = [10.0 ** (k / 8) for k in range(-16, 17)]
OPAQUE = 0.999


def slab(situation: StabilityContext) -> Iterator[Finding]:
    """A4: the largest opacity of a solid slab as thick as half of the box that a reading can reach with any weights, if
    the scene is written in a unit of length that makes it `scale` times as large.
    """
    del situation
    rows: list[list[str | float | None]] = []
    for reading, (whose_it_is, sigma, per_box) in solids().items():
        opacities = {scale: -math.expm1(-sigma * (1.0 if per_box else scale)) for scale in SCALES}
        ceilings = {scale: psnr_from_mse((1.0 - opacity) ** 2) for scale, opacity in opacities.items()}
        rows.append([reading, sigma, *opacities.values(), *(finite_or_none(value) for value in ceilings.values())])
        ends = ", ".join(f"{ceilings[scale]:.1f} dB at scale {scale:g}" for scale in (0.1, 1.0, 10.0))
        worst = min(opacities[scale] for scale in (0.1, 1.0, 10.0))
        why = f"densities end at {sigma:.3g} per {'half of the box' if per_box else 'scene unit'}"
        if worst < OPAQUE:
            why += f"; cannot be opaque: a black silhouette on white ends at {ends}"
        yield check(
            "largest opacity of a solid as thick as half of the box, the worst of scene scales 0.1, 1 and 10",
            worst,
            low=OPAQUE,
            why=why,
            subject=reading,
            owner=whose_it_is,
        )
        yield Series(
            "Opacity within reach of a slab as thick as half of the box", 5, reading, "scene scale", "largest opacity",
            DENSE_SCALES, [-math.expm1(-sigma * (1.0 if per_box else scale)) for scale in DENSE_SCALES], log_y=False,
        )  # fmt: skip
    columns = ["amplifier", "largest density", *(f"opacity at {scale:g}" for scale in SCALES)]
    columns += [f"PSNR ceiling of a silhouette at {scale:g}, dB" for scale in SCALES]
    yield Table(
        "slab", 5, "Opacity within reach, and what a black silhouette on white then scores at best", columns, rows
    )


def solids() -> dict[str, tuple[Owner, float, bool]]:
    """Return subject → its owner, its largest density, and whether that is per half of the box, else per scene unit."""
    readings = {reading: (whose, DENSITY_SCALE * largest_density(reading), True) for reading, whose in WHOSE.items()}
    return readings | {"listing2, 1 per scene unit": ("paper", largest_density("listing2"), False)}


@torch.no_grad()
def largest_density(reading: str) -> float:
    """Return the largest density over raw outputs up to ±1e4 of a network, any share of geometry in the chunk, α and
    β.
    """
    found = 0.0
    for matter, empty, share, alpha, beta in product(
        (1.0, 10.0, 1e2, 1e4), (-1e4, 0.0, 1e4), (0.01, 0.5, 1.0), (0.0, 1.0 / PHI, 1.0, 10.0, 1e3), (1.0, 10.0, 1e3)
    ):
        raw = torch.full((100,), empty)
        raw[: round(100 * share)] = matter
        after = amplifier_with(reading, alpha=alpha, beta=beta).before_and_after(raw)[1]
        found = max(found, float(after[0]))
    return found


# A5

ALPHAS = (-1.0, 0.0, 1.0 / PHI, 10.0, 1e3, math.inf)


def raw_inputs() -> dict[str, Tensor]:
    """Return raw outputs that a network may have."""
    decades = torch.tensor([0.0, *(sign * 10.0**k for k in range(-45, 31, 3) for sign in (1.0, -1.0))])
    above = torch.nextafter(torch.tensor(0.0), torch.tensor(1.0))
    return {
        "spread": 4.0 * torch.randn(512, generator=generator_for("stability", "A5")),
        "sixty decades": decades,
        "±1e4": torch.tensor([1e4, -1e4, 1e4, -1e4]),
        "all equal": torch.full((64,), 0.25),
        "σ = 0.5 ± ulp": torch.cat([torch.zeros(8), above.repeat(8), torch.tensor([1.2e-7, -1.2e-7])]),
    }


def extremes(situation: StabilityContext) -> Iterator[Finding]:
    """A5: outputs and gradients at extreme inputs; how much of a field is dead over a real training."""
    rows: list[list[str | float | None]] = []
    for reading, whose_it_is in WHOSE.items():
        has_alpha = isinstance(getattr(AMPLIFIERS[reading](), "alpha", None), nn.Parameter)
        bad: list[str] = []
        for alpha in ALPHAS if has_alpha else (1.0,):
            worst_dead, inverted = 0.0, False
            for name, raw in raw_inputs().items():
                finite, dead, upside_down = looked_at(reading, alpha, raw)
                if not finite:
                    bad.append(f"{name} at α = {alpha:g}")
                if name == "spread":
                    worst_dead, inverted = dead, upside_down
            rows.append([reading, f"{alpha:g}" if has_alpha else None, worst_dead, "inverted" if inverted else "kept"])
        yield check(
            "inputs whose output or gradient is not finite",
            len(bad),
            high=0,
            why=", ".join(bad),
            subject=reading,
            owner=whose_it_is,
        )
    yield Table(
        "amplifier-extremes", 6, "Raw densities of standard deviation 4: share without a gradient, order of densities",
        ["amplifier", "α", "dead share", "order"], rows,
    )  # fmt: skip
    yield check(
        "jump of density over the threshold of β = 2, within 2e-7 of raw density",
        jump_at_threshold(2.0),
        high=1e-6,
        why="a step of the density field, at which the boost has no gradient",
        subject="listing2, threshold",
        owner="paper",
    )
    for method in ("nerf", "qnerf", "qnerf_theorem", "qnerf_listing4", "qnerf_repaired"):
        if method in situation.methods:
            yield from _dead_over_training(situation, method)


def looked_at(reading: str, alpha: float, raw: Tensor) -> tuple[bool, float, bool]:
    """Return whether outputs and all gradients are finite, the share of dead points, and whether dense has become
    thin.
    """
    amplifier = amplifier_with(reading, alpha=alpha)
    raw = raw.clone().requires_grad_()
    before, after = amplifier.before_and_after(raw)
    after.sum().backward()
    gradients = [raw.grad, *(weight.grad for weight in amplifier.parameters())]
    finite = all(bool(torch.isfinite(one).all()) for one in (before, after, *gradients) if one is not None)
    with torch.no_grad():
        dead = float(at_an_end(before, after, 1.0 if amplifier.bounded else math.inf).float().mean())
        together = torch.cov(torch.stack([before, after]).double())[0, 1]
    return finite, dead, bool(together < 0)


@torch.no_grad()
def jump_at_threshold(beta: float) -> float:
    """Return |σ′(raw just above 0) − σ′(raw = 0)| of Listing 2: sigmoid(0) lies exactly on its threshold."""
    after = amplifier_with("listing2", beta=beta).before_and_after(torch.tensor([0.0, 2e-7]))[1]
    return float((after[1] - after[0]).abs())


def _dead_over_training(situation: StabilityContext, method: str) -> Iterator[Finding]:
    history = trained(situation, method)
    steps, shares = zip(*history.dead, strict=True)
    # what Eq. 4 puts below 0 is empty space that no gradient reaches, whoever holds the mean
    theirs: Owner = "ours" if history.trainer.amplifier_scalars()["alpha"] is None else "paper"
    yield Series(
        "Points of the box whose density no gradient reaches", 6, method, "step", "share",
        [float(step) for step in steps], list(shares), log_x=False, log_y=False,
    )  # fmt: skip
    yield check(
        f"share of points without a gradient of density after {steps[-1]} steps",
        shares[-1],
        high=DEAD_BAR,
        why="" if (scalars := history.trainer.amplifier_scalars())["alpha"] is None else f"α = {scalars['alpha']:.3g}",
        subject=f"{method}, trained",
        owner=theirs,
    )


DEAD_BAR = 0.01
"""Vanilla NeRF's softplus has none; measured 0."""


DTYPES = {"float32": torch.float32, "bfloat16": torch.bfloat16, "float16": torch.float16}
POINTS = 4096
COLOUR_BAR = 0.5 / 255
"""Half a step of an 8-bit picture; measured 5e-4 for bfloat16 and 5e-5 for float16."""


@torch.no_grad()
def layers(field: NetworkField, position: Tensor, dtype: torch.dtype, fed: list[Tensor] | None = None) -> list[Tensor]:
    """Return rectified outputs of each density layer and the raw density, [points, width] each, with matrix
    multiplications in `dtype`.

    With `fed`, the outputs of another precision, each layer gets that one's input instead of its own.
    """
    position = position.to(dtype)
    h, again, found = position, None, []
    for index, layer in enumerate([*field.density_net, field.density_head]):
        x = h if again is None else torch.cat([h, again], dim=-1)
        weight, bias = layer.weight.detach().to(dtype), layer.bias.detach().to(dtype)
        h = torch.nn.functional.linear(x, weight, bias)
        h = torch.relu(h) if index < len(field.density_net) else h
        found.append(h)
        h = h if fed is None else fed[index].to(dtype)
        again = position if index == field.skip else None
    return found


def digits(found: Tensor, truth: Tensor) -> float:
    """Return −log10 of the root mean square error relative to the truth's root mean square."""
    error = (found.double() - truth).square().mean().sqrt()
    return float(-torch.log10(error / truth.square().mean().sqrt()))


def digits_by_layer(situation: StabilityContext) -> Iterator[Finding]:
    """O3: every method's trained network against its float64 twin, fed the same encoded positions."""
    rows: list[list[str | float | None]] = []
    for method in situation.methods:
        if reason := not_made_of_parts(method):
            yield Check("", None, why=reason, subject=method, owner=whose(method), status="not_applicable")
            continue
        field = trained(situation, method).trainer.field
        points = torch.rand(256 if situation.quick else POINTS, 3, generator=generator_for("stability", "O3"))
        position = encode(field.box.normalised(field.box.from_unit(points)), field.base, field.position_bands)
        truth = layers(field, position, torch.float64)
        names = [f"layer {index + 1}" for index in range(len(truth) - 1)] + ["raw density"]
        exact = [digits(one, true) for one, true in zip(layers(field, position, torch.float32), truth, strict=True)]
        for name, dtype in DTYPES.items():
            through = [digits(a, b) for a, b in zip(layers(field, position, dtype), truth, strict=True)]
            alone = [digits(a, b) for a, b in zip(layers(field, position, dtype, fed=truth), truth, strict=True)]
            yield Series(
                f"Digits left in {method}, layer by layer", 7, name, "layer", "decimal digits",
                [float(index + 1) for index in range(len(truth))], through, log_x=False, log_y=False,
            )  # fmt: skip
            rows += [
                [method, name, layer, through[i], exact[i] - through[i], alone[i]] for i, layer in enumerate(names)
            ]
        yield from _seen(situation, method)
    columns = [
        "method",
        "products",
        "after",
        "digits left",
        "digits lost to float32",
        "digits left by this layer alone",
    ]
    yield Table("digits", 7, "Digits of a trained network, against its float64 twin fed the same", columns, rows)


def _seen(situation: StabilityContext, method: str) -> Iterator[Finding]:
    """Yield how much of the loss is visible: the same weights rendered with matrix multiplications of reduced
    precision.
    """
    source = trained(situation, method).trainer
    rays = setup(situation).test.all_rays(0)
    exact = source.render(rays, len(rays)).colour
    for precision in ("bfloat16", "float16"):
        settings = replace(source.settings, precision=precision)
        twin = new_trainer(situation, method, settings)
        twin.fields.load_state_dict(source.fields.state_dict())
        twin.step, twin.grid = source.step, source.grid
        apart = twin.render(rays, len(rays)).colour - exact
        yield check(
            "root mean square change of a colour (0 … 1) that reduced products alone make",
            math.sqrt(float(apart.square().mean())),
            high=COLOUR_BAR,
            why=f"largest {float(apart.abs().max()):.2g}",
            subject=f"{method}, {precision}",
            owner=whose(method),
        )
