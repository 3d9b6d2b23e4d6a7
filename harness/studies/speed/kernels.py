"""Questions 4 to 7: rendered views, encodings, quadrature and Mitsuba's variants, compared with the usual forms."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path

import torch
from torch import Tensor

from baselines.contract import NO_ACCELERATION
from baselines.numerics.encoding import PHI, encode, fourier_features, frequency_ladder
from baselines.numerics.quadrature import listing4, midpoint
from harness.execution.ground_truth import sizes_of
from harness.plan.settings import ViewSettings
from harness.records.study import Check
from harness.studies.speed.speed_context import (
    SpeedContext,
    figure,
    interleaved,
    new_trainer,
    no_figure,
    paper_settings,
    ratio,
    reduced_plan,
    views_of,
)
from harness.studies.usual_quadrature import running_product, stock_expm1
from harness.training.lockstep import box_of
from harness.training.scoring.evaluate import cameras_of, render_view
from scenes.files.errors import InputError
from scenes.rendering.variant import VARIANTS, Variant, choose_variant

POINTS = 65536
"""The points per training step of the paper."""


def encodings(context: SpeedContext) -> Iterator[Check]:
    points = 512 if context.quick else POINTS
    x = (2.0 * torch.rand(points, 3, generator=torch.Generator().manual_seed(0)) - 1.0).to(context.device)
    detail = f"{points} points of 3 axes, float32, {context.threads} threads"
    for (name, symbol, base), bands in product((("phi", "φ^k", PHI), ("base2", "2^k", 2.0)), (10, 4)):
        ladder = frequency_ladder(base, bands).to(x.device)
        sides = {
            "direct": partial(fourier_features, x, ladder),
            "adjacent": partial(encode, x, base, bands),
        }
        seconds = interleaved(sides, context.repeats(9), context.synchronise, 0.01 if context.quick else 0.1)
        id, what = f"encoding.{name}.{bands}", f"{symbol}, L = {bands}"
        title = f"Encoding {what}, points of a feature adjacent against Listing 1's order"
        yield ratio(id, title, seconds["direct"], seconds["adjacent"], detail)


Rule = Callable[[Tensor, Tensor, Tensor], tuple[Tensor, Tensor]]
"""Densities, points and fenceposts → weights and the remaining transmittance."""
SIZE, QUICK_SIZE = (4096, 192), (64, 16)
"""Rays, and bins per ray."""


def _rule(
    weights: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]],
    lengths: Callable[[Tensor, Tensor], Tensor] = lambda t, t_edges: torch.diff(t_edges, dim=-1),
) -> Rule:
    return lambda sigma, t, t_edges: weights(sigma, lengths(t, t_edges))


RULES: dict[str, tuple[str, Rule]] = {
    "midpoint": ("closed-form gradient", _rule(midpoint.weights, midpoint.lengths)),
    "autograd": ("the same rule by autograd", _rule(stock_expm1)),
    "product": ("running product by autograd", _rule(running_product)),
    "listing4": ("Listing 4 of the paper", _rule(listing4.weights, listing4.lengths)),
}


def quadrature(context: SpeedContext) -> Iterator[Check]:
    rays, bins = QUICK_SIZE if context.quick else SIZE
    generator = torch.Generator().manual_seed(0)
    t_edges = torch.linspace(2.0, 6.0, bins + 1).expand(rays, -1).contiguous()
    t = 0.5 * (t_edges[:, 1:] + t_edges[:, :-1])
    sigma = torch.rand(rays, bins, generator=generator) ** 8 * 50.0  # mostly empty, some solid
    gradients = torch.randn(rays, bins, generator=generator), torch.randn(rays, generator=generator)
    t_edges, t, sigma, *upstream = (given.to(context.device) for given in (t_edges, t, sigma, *gradients))
    sigma.requires_grad_()

    def forward_and_backward(rule: Rule) -> Tensor:
        w, T_end = rule(sigma, t, t_edges)
        (gradient,) = torch.autograd.grad((w * upstream[0]).sum() + (T_end * upstream[1]).sum(), sigma)
        return gradient

    sides = {name: partial(forward_and_backward, rule) for name, (_, rule) in RULES.items()}
    seconds = interleaved(sides, context.repeats(9), context.synchronise, 0.01 if context.quick else 0.1)
    detail = f"{rays} rays × {bins} bins, float32, forward and backward, {context.threads} threads"
    reference, *others = RULES
    for name in others:
        title = f"Quadrature with closed-form gradient against {RULES[name][0]}"
        yield ratio(f"quadrature.{name}", title, seconds[name], seconds[reference], detail)
    milliseconds = [1e3 * taken for taken in seconds[reference]]
    title = "Quadrature with closed-form gradient"
    yield figure("quadrature.midpoint.milliseconds", title, milliseconds, "ms", detail)


def rendering(context: SpeedContext) -> Iterator[Check]:
    """Time the paper's network with every sample evaluated; question 11 times the reduced profile."""
    views, plan, paper = views_of(context), reduced_plan(context), paper_settings(context)
    cameras, box = cameras_of(views, views.test, context.device), box_of(views, context.device)
    plain = replace(paper, precision="float32", accelerations=NO_ACCELERATION)
    show = partial(render_view, cameras=cameras, view=len(cameras) // 2, chunk=plan.score.chunk)
    sides = {
        "on": partial(show, new_trainer(context, paper, box)),
        "off": partial(show, new_trainer(context, plain, box)),
    }
    seconds = interleaved(sides, context.repeats(3), context.synchronise)
    a_view = f"A view of {cameras.width} × {cameras.height}"
    detail = f"{paper.network.depth} × {paper.network.width}, {paper.bins} samples per ray, all evaluated"
    title = f"{a_view}, paper's network, {paper.precision} against float32 without accelerations"
    yield ratio("rendering.paper", title, seconds["off"], seconds["on"], detail)
    yield figure("rendering.paper.seconds", f"{a_view}, paper's network", seconds["on"], "s", detail)


SCENES = ("lego", "hotdog")
REFERENCE = "scalar_rgb"


def ground_truth(context: SpeedContext) -> Iterator[Check]:
    """Time megasamples without the first view of each process, which loads and compiles."""
    resolution, count, spp = (16, 3, 4) if context.quick else (100, 7, 64)
    views = ViewSettings(resolution, train=count, val=0, test=0, spp_train=spp, spp_test=spp)
    usable: list[Variant] = []
    for name in VARIANTS:
        try:
            usable.append(choose_variant(name))
        except InputError as refusal:
            yield no_figure(f"render.{name}.seconds", f"Ground truth, {name}", "s/megasample", str(refusal))
    detail = f"{count} views of {resolution} px, {spp} samples per pixel, geometry included"
    for scene in SCENES[:1] if context.quick else SCENES:
        taken: dict[str, list[float]] = {variant.name: [] for variant in usable}
        for repetition in range(1 if context.quick else 3):
            for variant in usable:
                cache = context.scratch / f"rendered-{scene}-{variant.name}-{repetition}"
                taken[variant.name].append(seconds_per_view(scene, views, variant, cache) / (resolution**2 * spp / 1e6))
                shutil.rmtree(cache, ignore_errors=True)
        for name, seconds in taken.items():
            id, title = f"render.{scene}.{name}", f"Ground truth of {scene}, {name}"
            yield figure(f"{id}.seconds", title, seconds, "s/megasample", detail)
            if name != REFERENCE:
                yield ratio(id, f"{title} against {REFERENCE}", taken[REFERENCE], seconds, detail)


def seconds_per_view(scene: str, views: ViewSettings, variant: Variant, cache: Path) -> float:
    """Return the mean seconds of the views after the first. Raises `RuntimeError` if the renderer fails."""
    words = [*sizes_of(views), "--variant", variant.name, "--view-sets", str(cache)]
    command = [sys.executable, "-m", "scenes", "render", scene, *words]
    environment = {**os.environ, **variant.environment()}
    with (
        tempfile.TemporaryFile("w+") as complaints,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=complaints, text=True, env=environment) as process,
    ):
        assert process.stdout is not None
        try:
            moments = [time.perf_counter() for line in process.stdout if json.loads(line).get("done")]
            code = process.wait()
        finally:
            process.kill()
        complaints.seek(0)
        if code or len(moments) < 2:
            told = complaints.read().strip()[-500:]
            raise RuntimeError(f"rendering {scene} with {variant.name} ended with {code}: {told}")
    return (moments[-1] - moments[0]) / (len(moments) - 1)
