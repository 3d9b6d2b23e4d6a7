"""A2, C2, S8: whether a pixel depends on the other pixels of its chunk, or on the unit of length."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from baselines.contract import Rays
from baselines.marching.sampling_plan import Sampling
from baselines.rendering import render_rays
from harness.plan.seeds import generator_for
from harness.records.study import Owner, Series, Table, check
from harness.studies.framework import Found, Rows
from harness.studies.stability.fields import small_training
from harness.studies.stability.stability_context import StabilityContext, owner_of_method, worst_of
from harness.training.batches import Batches, Cameras
from harness.training.checkpoints import load_checkpoint, save_checkpoint
from harness.training.lockstep import box_of
from harness.training.scoring import evaluate, metrics
from harness.training.scoring.evaluate import cameras_of
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import Split, ViewSet

BAR = 2e-6
EVERYTHING = 1 << 20
"""More rays than a view has, so that it is one chunk."""
OTHER_POINTS = "other points"
"""The only comparison of opacities; all others compare colours."""


def chunks(context: StabilityContext) -> Iterator[Found]:
    by_subject: dict[str, dict[str, float]] = {}
    methods, others = small_training.with_parts(context)
    for method in methods:
        by_subject[method] = apart = differences(context, small_training.trained(context, method).trainer)
        worst = _largest(apart)
        of = "a colour (0 … 1), the same pixel" if worst != OTHER_POINTS else "the opacity of a bin, the same point"
        what, why = f"largest difference of {of} in other chunks", f"worst: {worst}"
        yield check(what, apart[worst], high=BAR, why=why, subject=method, owner=owner_of_method(method))
    yield from others
    ways = list(dict.fromkeys(way for apart in by_subject.values() for way in apart))
    rows: Rows = [[subject, *map(apart.get, ways)] for subject, apart in by_subject.items()]
    title = f"The same pixels in other chunks: largest difference of a colour ({OTHER_POINTS}: of an opacity)"
    yield Table("calls", 4, title, ["subject", *ways], rows)


def _largest(apart: dict[str, float]) -> str:
    return max(apart, key=lambda name: apart[name] if math.isfinite(apart[name]) else math.inf)


def _apart(a: Tensor, b: Tensor) -> float:
    return float((a - b).abs().max())


def differences(context: StabilityContext, trainer: Trainer) -> dict[str, float]:
    """Return way → largest difference from the complete view in one chunk."""
    rays = small_training.setup(context).test.all_rays(0)
    complete = trainer.render(rays, EVERYTHING).colour
    few = slice(3 * len(rays) // 8, 3 * len(rays) // 8 + (16 if context.quick else 256))
    some = rays.part(few.start, few.stop)
    order = torch.randperm(len(rays), generator=generator_for("stability", "order"))
    origins, directions = (torch.cat([values[few], values.flip(0)[:300]]) for values in (rays.origins, rays.directions))
    padded = Rays(origins, directions, rays.near, rays.far)
    return {
        "chunks of 1": _apart(trainer.render(some, 1).colour, complete[few]),
        "chunks of 16": _apart(trainer.render(rays, 16).colour, complete),
        "chunks of 256": _apart(trainer.render(rays, 256).colour, complete),
        "shuffled": _apart(trainer.render(rays.chosen(order), 256).colour, complete[order]),
        "padded": _apart(trainer.render(padded, EVERYTHING).colour[: len(complete[few])], complete[few]),
        OTHER_POINTS: opacity_with_other_points(trainer),
        "training mode": recorded_or_not(trainer, some),
        "reloaded": _apart(reloaded(context, trainer).render(rays, EVERYTHING).colour, complete),
    }


@torch.no_grad()
def opacity_with_other_points(trainer: Trainer) -> float:
    """Return the largest change of a bin's opacity from evenly spread points (coarse pass) to the densest (fine)."""
    x = trainer.box.from_unit(torch.rand(small_training.PROBES, 3, generator=generator_for("stability", "company")))
    sigma = trainer.field.density(x)
    densest = torch.topk(sigma, len(x) // 8).indices
    bin_length = float((trainer.box.upper - trainer.box.lower).max()) / trainer.settings.bins
    separately = trainer.field.density(x[densest])
    return _apart(torch.exp(-separately * bin_length), torch.exp(-sigma[densest] * bin_length))


def recorded_or_not(trainer: Trainer, rays: Rays) -> float:
    """Return the largest difference of a colour between rendering with gradients, as in training, and without."""
    sampling = Sampling(trainer.settings.bins, quadrature=trainer.quadrature, clip_to_box=not trainer.whole_rays)

    def colour() -> Tensor:
        fields = (trainer.coarse, trainer.fine)
        rendering = render_rays(*fields, rays, trainer.box, sampling, trainer.grid, trainer.background, None)
        return rendering.colour.detach()

    recorded = colour()
    with torch.no_grad():
        return _apart(recorded, colour())


def reloaded(context: StabilityContext, trainer: Trainer) -> Trainer:
    file = context.scratch / f"reload-{trainer.method}.safetensors"
    save_checkpoint(trainer, file)
    fresh = small_training.new_trainer(context, trainer.method, trainer.settings)
    load_checkpoint(fresh, file, trainer.step)
    return fresh


SIZES = ((1, 1), (9, 1), (1, 9), (5, 3), (12, 11))


def odd_sizes(context: StabilityContext) -> Iterator[Found]:
    methods, others = small_training.with_parts(context)
    for method in methods:
        trainer = small_training.trained(context, method).trainer
        sizes = SIZES[:3] if context.quick else SIZES
        apart = {f"{width} × {height}": _odd(context, trainer, width, height) for width, height in sizes}
        worst = _largest(apart)
        what, why = "largest difference of a colour to a loop over rays", f"worst at {worst}"
        yield check(what, apart[worst], high=BAR, why=why, subject=method, owner=owner_of_method(method))
    yield from others
    what = "scores of small pictures that are not finite (PSNR, SSIM, linear error)"
    count = sum(not math.isfinite(score) for size in SIZES for score in scores_of(*size))
    yield check(what, count, high=0, subject="metrics")


def _odd(context: StabilityContext, trainer: Trainer, width: int, height: int) -> float:
    """Return the difference for chunks of 4 rays; for most of these sizes the last chunk is partial."""
    test = small_training.setup(context).test
    cameras = Cameras(test.camera_to_world[:1], width, height, 1.6 * max(width, height), test.near, test.far)
    rendered = evaluate.render_view(trainer, cameras, 0, 4).colour
    rays = cameras.all_rays(0)
    one_by_one = torch.cat([trainer.render(rays.part(i, i + 1), 1).colour for i in range(len(rays))])
    return float(np.abs(rendered - one_by_one.numpy().reshape(height, width, 3)).max())


def scores_of(width: int, height: int) -> list[float]:
    generator = np.random.default_rng(width * 100 + height)
    first, second = generator.uniform(size=(2, height, width, 3)).astype(np.float32)
    pairs = [(first, second), (first, first)]
    scores = [score(*pair) for score in (metrics.ssim, metrics.rmse_linear) for pair in pairs]
    return [*scores, metrics.psnr(first, second)]


UNITS = (0.1, 10.0, 25.0)
"""The number of new units of length per old unit; coordinates are rounded again, as these are not powers of two."""
EXACT = 8.0
"""A power of two rounds nothing: what does not depend on the unit keeps every bit."""
LARGEST_CHANGE_DB = 0.5
"""The tolerance of rounding, which grows with every step: processors differ by 0.30 dB RMS after 1000 steps."""
METHODS = ("nerf", "nerf_matched", "qnerf", "qnerf_printed", "qnerf_theorem", "qnerf_repaired")


def rescaled(views: ViewSet, k: float) -> ViewSet:
    """Return the same images with all lengths written in a unit that is 1 / k as long."""

    def moved(split: Split) -> Split:
        poses = np.array(split.camera_to_world, copy=True)
        poses[:, :3, 3] *= k
        return replace(split, camera_to_world=poses, depth=None)

    train, val, test = map(moved, (views.train, views.val, views.test))
    near, far, bounds = k * views.near, k * views.far, k * views.bounds
    return replace(views, train=train, val=val, test=test, near=near, far=far, bounds=bounds)


def psnr_in_unit(context: StabilityContext, method: str, k: float) -> float:
    views = rescaled(small_training.setup(context).views, k)
    trainer = small_training.new_trainer(context, method, box=box_of(views, small_training.CPU))
    batches = Batches(cameras_of(views, views.train, small_training.CPU), views.train.rgba)
    small_training.train(context, trainer, batch_at=batches.stream(small_training.STREAM, trainer.settings.rays))
    return small_training.psnr_of(trainer, views)


def units_of_length(context: StabilityContext) -> Iterator[Found]:
    for method in METHODS:
        psnr = {k: psnr_in_unit(context, method, k) for k in (1.0, EXACT, *UNITS)}
        owner: Owner = "paper" if method == "qnerf_printed" else "ours"
        units = ", ".join(f"{k:g}" for k in UNITS)
        what = f"largest change of test PSNR where the unit of length is 1/k as long, k = {units}"
        change = worst_of(abs(psnr[k] - psnr[1.0]) for k in UNITS)
        yield check(what, change, high=LARGEST_CHANGE_DB, unit="dB", subject=method, owner=owner)
        what = f"change of test PSNR for k = {EXACT:g}, which rounds nothing"
        yield check(what, abs(psnr[EXACT] - psnr[1.0]), high=0.0, unit="dB", subject=method, owner=owner)
        panel, x = "Test PSNR against the unit of length of the poses", sorted(psnr)
        yield Series(panel, 10, method, "k", "dB", x, [psnr[k] for k in x], log_y=False)
