"""Questions 4 to 7: rendered views, encodings, quadrature and Mitsuba's variants, each against the usual
implementation.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import torch
from torch import Tensor

from baselines.contract import NO_ACCELERATION
from baselines.numerics.encoding import PHI, encode, fourier_features, frequency_ladder
from baselines.numerics.quadrature import Rule as QuadratureRule
from baselines.numerics.quadrature import listing4, midpoint
from harness.records.study import Check
from harness.studies.speed.speed_context import (
    SpeedContext,
    interleaved,
    measured,
    new_trainer,
    not_measured,
    paper_settings,
    quotients,
    reduced_plan,
    trained_reduced,
    variant_of,
    views_of,
)
from harness.training.evaluate import cameras_of, render_view
from harness.training.lockstep import box_of
from scenes.files.errors import InputError
from scenes.rendering.variant import VARIANTS, Variant, choose_variant

POINTS = 65536
"""The points of a step of the paper."""


def encodings(situation: SpeedContext) -> Iterator[Check]:
    points = 512 if situation.quick else POINTS
    x = 2.0 * torch.rand(points, 3, generator=torch.Generator().manual_seed(0)) - 1.0
    x = x.to(situation.device)
    for name, base in (("phi", PHI), ("base2", 2.0)):
        for bands in (10, 4):
            yield from _compare(situation, name, base, bands, x)


def _compare(situation: SpeedContext, name: str, base: float, bands: int, x: Tensor) -> Iterator[Check]:
    ladder = frequency_ladder(base, bands).to(x.device)
    seconds = interleaved(
        {
            "direct": lambda: fourier_features(x, ladder),
            "sines": lambda: encode(x, base, bands, recurrence=False),
            "recurrence": lambda: encode(x, base, bands, recurrence=True),
        },
        situation.repeats(9),
        situation.synchronise,
        0.01 if situation.quick else 0.1,
    )
    symbol = "φ^k" if name == "phi" else "2^k"
    id, what = f"encoding.{name}.{bands}", f"{symbol}, L = {bands}"
    detail = f"{len(x)} points of 3 axes, float32, {situation.threads} threads"
    yield measured(
        f"{id}.ratio",
        f"Encoding {what}, recurrence against direct sines and cosines",
        quotients(seconds["direct"], seconds["recurrence"]),
        "×",
        target=3.0 if (name, bands) == ("phi", 10) and situation.device.type == "cpu" else None,
        detail=detail,
    )
    yield measured(
        f"{id}.sines.ratio",
        f"Encoding {what}, `encode` without recurrence against direct",
        quotients(seconds["direct"], seconds["sines"]),
        "×",
        detail=detail,
    )
    for side, features in (
        ("direct", fourier_features(x, ladder)),
        ("recurrence", encode(x, base, bands, recurrence=True)),
    ):
        yield measured(
            f"{id}.{side}.error",
            f"Largest error of {what} against float64, {side}",
            [largest_error(features, x, base, bands)],
            "",
            detail=f"{len(x)} random points in [−1, 1]³",
        )


def largest_error(features: Tensor, x: Tensor, base: float, bands: int) -> float:
    """Return the largest absolute error, against sines and cosines in float64 of the very same float32 coordinates."""
    ladder = torch.tensor([base**k for k in range(bands)], dtype=torch.float64, device=x.device)
    return float((features.double() - fourier_features(x.double(), ladder)).abs().max())


Rule = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]
"""Densities, points and fenceposts → weights and the remaining transmittance."""


SIZE = (4096, 192)
"""Rays, and bins of each."""


def by_autograd(sigma: Tensor, t: Tensor, t_edges: Tensor) -> tuple[Tensor, Tensor]:
    """Evaluate the rule of `midpoint`, differentiated operation by operation."""
    del t
    tau = sigma * torch.diff(t_edges, dim=-1)
    through = torch.cumsum(tau, dim=-1)
    before = torch.cat([torch.zeros_like(through[:, :1]), through[:, :-1]], dim=-1)
    return torch.exp(-before) * -torch.expm1(-tau), torch.exp(-through[:, -1])


def by_product(sigma: Tensor, t: Tensor, t_edges: Tensor) -> tuple[Tensor, Tensor]:
    """Evaluate the rule as it is usually written: opacities, and a running product of what they let through."""
    del t
    alpha = 1.0 - torch.exp(-sigma * torch.diff(t_edges, dim=-1))
    through = torch.cumprod(torch.cat([torch.ones_like(alpha[:, :1]), 1.0 - alpha + 1e-10], dim=-1), dim=-1)
    return alpha * through[:, :-1], through[:, -1]


def unchecked(rule: QuadratureRule) -> Rule:
    """Return the rule as the renderer uses it, which makes its own fenceposts."""
    return lambda sigma, t, t_edges: rule.weights(sigma, rule.lengths(t, t_edges))


RULES: dict[str, tuple[str, Rule]] = {
    "midpoint": ("closed-form gradient", unchecked(midpoint)),
    "autograd": ("the same rule by autograd", by_autograd),
    "product": ("running product by autograd", by_product),
    "listing4": ("Listing 4 of the paper", unchecked(listing4)),
}


def quadrature(situation: SpeedContext) -> Iterator[Check]:
    rays, bins = (64, 16) if situation.quick else SIZE
    generator = torch.Generator().manual_seed(0)
    t_edges = torch.linspace(2.0, 6.0, bins + 1).expand(rays, -1).contiguous()
    t = 0.5 * (t_edges[:, 1:] + t_edges[:, :-1])
    sigma = torch.rand(rays, bins, generator=generator) ** 8 * 50.0  # mostly empty, some solid
    gradients = torch.randn(rays, bins, generator=generator), torch.randn(rays, generator=generator)
    t_edges, t, sigma, *upstream = (one.to(situation.device) for one in (t_edges, t, sigma, *gradients))
    sigma.requires_grad_()

    def side(rule: Rule) -> Callable[[], object]:
        def forward_and_backward() -> Tensor:
            w, T_end = rule(sigma, t, t_edges)
            (gradient,) = torch.autograd.grad((w * upstream[0]).sum() + (T_end * upstream[1]).sum(), sigma)
            return gradient

        return forward_and_backward

    seconds = interleaved(
        {name: side(rule) for name, (_, rule) in RULES.items()},
        situation.repeats(9),
        situation.synchronise,
        0.01 if situation.quick else 0.1,
    )
    detail = f"{rays} rays × {bins} bins, float32, forward and backward, {situation.threads} threads"
    for name, (title, _) in RULES.items():
        if name != "midpoint":
            yield measured(
                f"quadrature.{name}.ratio",
                f"Quadrature with closed-form gradient against {title}",
                quotients(seconds[name], seconds["midpoint"]),
                "×",
                detail=detail,
            )
    milliseconds = [1e3 * one for one in seconds["midpoint"]]
    yield measured(
        "quadrature.midpoint.milliseconds", "Quadrature with closed-form gradient", milliseconds, "ms", detail=detail
    )


def rendering(situation: SpeedContext) -> Iterator[Check]:
    """Yield the same weights, with and without accelerations; and the paper's network, every sample evaluated."""
    views = views_of(situation, "lego")
    cameras = cameras_of(views, views.test, situation.device)
    # with directions on both sides, as a field without them is another one
    fast = trained_reduced(situation, view_dependent=True)
    slow = variant_of(fast, situation, NO_ACCELERATION)
    paper = paper_settings(situation)
    dense = new_trainer(situation, paper, box_of(views, situation.device), view_dependent=True)
    plain = new_trainer(
        situation,
        replace(paper, precision="float32", accelerations=NO_ACCELERATION),
        box_of(views, situation.device),
        view_dependent=True,
    )
    plan = reduced_plan(situation)
    chunk = plan.score.chunk
    view = len(cameras) // 2
    pixels = f"{cameras.width} × {cameras.height}"
    seconds = interleaved(
        {name: partial(render_view, one, cameras, view, chunk) for name, one in (("on", fast), ("off", slow))},
        situation.repeats(7),
        situation.synchronise,
        0.1,
    )
    settings = f"reduced settings after {fast.step} steps, {plan.train.precision} on both sides, chunks of {chunk} rays"
    yield measured(
        "rendering.reduced.ratio",
        f"A view of {pixels}, accelerations on against off",
        quotients(seconds["off"], seconds["on"]),
        "×",
        detail=settings,
    )
    for name, title in (("on", "all accelerations"), ("off", "none")):
        yield measured(
            f"rendering.reduced.{name}.seconds", f"A view of {pixels}, {title}", seconds[name], "s", detail=settings
        )
    whole = interleaved(
        {name: partial(render_view, one, cameras, view, chunk) for name, one in (("on", dense), ("off", plain))},
        situation.repeats(3),
        situation.synchronise,
    )
    words = f"{paper.network.depth} × {paper.network.width}, {paper.bins} samples a ray, every one evaluated"
    yield measured(
        "rendering.paper.ratio",
        f"A view of {pixels}, paper's network, {paper.precision} against float32 without accelerations",
        quotients(whole["off"], whole["on"]),
        "×",
        detail=words,
    )
    yield measured("rendering.paper.seconds", f"A view of {pixels}, paper's network", whole["on"], "s", detail=words)


SCENES = ("lego", "hotdog")
REFERENCE = "scalar_rgb"


@dataclass(frozen=True)
class Order:
    """The views to render: a few training views."""

    resolution: int
    views: int
    spp: int

    @property
    def megasamples_a_view(self) -> float:
        return self.resolution**2 * self.spp / 1e6


def ground_truth(situation: SpeedContext) -> Iterator[Check]:
    """Yield seconds per megasample in the steady state: without the first view of each process, which loads and
    compiles.
    """
    order = Order(16, 3, 4) if situation.quick else Order(100, 7, 64)
    scenes = SCENES[:1] if situation.quick else SCENES
    usable: list[Variant] = []
    for name in VARIANTS:
        try:
            usable.append(choose_variant(name))
        except InputError as refusal:
            yield not_measured(f"render.{name}.seconds", f"Ground truth, {name}", "s/megasample", str(refusal))
    repeats = 1 if situation.quick else 3
    for scene in scenes:
        taken: dict[str, list[float]] = {variant.name: [] for variant in usable}
        for repetition in range(repeats):
            for variant in usable:
                cache = situation.scratch / f"rendered-{scene}-{variant.name}-{repetition}"
                steady = seconds_a_view(scene, order, variant, cache)
                taken[variant.name].append(steady / order.megasamples_a_view)
                shutil.rmtree(cache, ignore_errors=True)
        detail = f"{order.views} views of {order.resolution} px, {order.spp} samples a pixel, geometry included"
        for variant in usable:
            yield measured(
                f"render.{scene}.{variant.name}.seconds",
                f"Ground truth of {scene}, {variant.name}",
                taken[variant.name],
                "s/megasample",
                detail=detail,
            )
            if variant.name != REFERENCE:
                yield measured(
                    f"render.{scene}.{variant.name}.ratio",
                    f"Ground truth of {scene}, {variant.name} against {REFERENCE}",
                    quotients(taken[REFERENCE], taken[variant.name]),
                    "×",
                    detail=detail,
                )


def seconds_a_view(scene: str, order: Order, variant: Variant, cache: Path) -> float:
    """Return the mean seconds of the views after the first, as the renderer reports them on its way.

    Raises `RuntimeError` with its error output if it fails.
    """
    options = {
        "resolution": order.resolution,
        "train": order.views,
        "val": 0,
        "test": 0,
        "spp-train": order.spp,
        "spp-test": order.spp,
        "variant": variant.name,
        "view-sets": cache,
    }
    words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    process = subprocess.Popen(
        [sys.executable, "-m", "scenes", "render", scene, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **variant.environment()},
    )
    assert process.stdout is not None
    assert process.stderr is not None
    moments: list[float] = []
    try:
        for line in process.stdout:
            if json.loads(line).get("done"):
                moments.append(time.perf_counter())
        said = process.stderr.read()
        code = process.wait()
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        process.stdout.close()
        process.stderr.close()
    if code or len(moments) < 2:
        raise RuntimeError(f"rendering {scene} with {variant.name} ended with {code}: {said.strip()[-500:]}")
    return (moments[-1] - moments[0]) / (len(moments) - 1)
