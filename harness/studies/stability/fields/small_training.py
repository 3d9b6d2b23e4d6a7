"""One small view set and methods trained on it for a few seconds, shared by all cases about training itself."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from baselines.catalog import CATALOG
from baselines.contract import Box, NetworkSize
from harness.execution.ground_truth import read_views, view_set_folders
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, TrainSettings
from harness.records.study import Check
from harness.studies.drawn_views import write_disc
from harness.studies.stability.stability_context import StabilityContext, not_judged, owner_of_method
from harness.training.batches import Batch, Batches, Cameras
from harness.training.learner import Job, at_step, steps
from harness.training.lockstep import box_of, needs_view_direction
from harness.training.scoring.evaluate import cameras_of, quick_scores, render_split
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet

SCENE = "lego"
STREAM = "stability/small"
CPU = torch.device("cpu")
PROBES = 4096
"""The random points of the box at which the amplifier is evaluated."""


@dataclass(frozen=True)
class Setup:
    views: ViewSet
    batches: Batches
    test: Cameras
    settings: TrainSettings
    steps: int


@dataclass
class History:
    trainer: Trainer
    losses: list[float] = field(default_factory=list)
    dead: list[tuple[int, float]] = field(default_factory=list)
    """Pairs (step, share of points whose density no gradient reaches)."""


def with_parts(context: StabilityContext) -> tuple[list[str], list[Check]]:
    """Return the methods made of encoding, amplifier and network, and a check of each method that is not."""
    made_of_parts = [method for method in context.methods if CATALOG[method].parts is not None]
    why = "no encoding, amplifier or network: a grid of values"
    others = [method for method in context.methods if method not in made_of_parts]
    return made_of_parts, [not_judged(method, why, owner=owner_of_method(method)) for method in others]


@cache
def setup(context: StabilityContext) -> Setup:
    """Return a rendered scene at 64 pixels and a 6 × 64 network; a drawn disc and a smaller one with `quick`."""
    plan = replace(context.plan("smoke", [SCENE]), methods=("nerf",))
    sizes, count = plan.views, 300
    if context.quick:
        folder, count = context.scratch / "small", 12
        write_disc(folder, sizes.resolution, sizes.train, sizes.test, seed=0)
        settings = replace(
            plan.train, network=NetworkSize(6, 16, 2, 16, 6, 2), rays=64, bins=12, first_bins=8,
            grid=GridSettings(cells=8, first_step=4, every=4),
        )  # fmt: skip
    else:
        sizes = replace(sizes, resolution=64, train=24, val=0, test=2)
        folder = view_set_folders(replace(plan, views=sizes), context.view_sets, context.show)[SCENE]
        settings = replace(plan.train, grid=GridSettings(cells=24, first_step=100, every=25))
    views = read_views(folder, sizes, context.scratch)
    batches = Batches(cameras_of(views, views.train, CPU), views.train.rgba)
    return Setup(views, batches, cameras_of(views, views.test, CPU), settings, count)


def new_trainer(
    context: StabilityContext, method: str, settings: TrainSettings | None = None, box: Box | None = None
) -> Trainer:
    here = setup(context)
    box, settings = box or box_of(here.views, CPU), settings or here.settings
    return Trainer(Job(method, box, settings, Budget(here.steps, None), STREAM, CPU, needs_view_direction(here.views)))


def train(
    context: StabilityContext,
    trainer: Trainer,
    count: int | None = None,
    batch_at: Callable[[int], Batch] | None = None,
    dead_every: int | None = None,
) -> History:
    """Train for the steps of the setup, or for `count` steps. Raises `Diverged`."""
    here, history = setup(context), History(trainer)
    batch_at = batch_at or here.batches.stream(STREAM, trainer.settings.rays)
    until = at_step(trainer.step + (here.steps if count is None else count))
    for _ in steps(trainer, batch_at, until):
        assert trainer.last_loss is not None
        history.losses.append(trainer.last_loss)
        if dead_every and (trainer.step % dead_every == 0 or trainer.step == 1):
            history.dead.append((trainer.step, dead_share(trainer)))
    return history


@cache
def trained(context: StabilityContext, method: str) -> History:
    """Return the method trained with its usual settings, once for all cases: none may change it."""
    return train(context, new_trainer(context, method), dead_every=1 if context.quick else 10)


def psnr_of(trainer: Trainer, views: ViewSet) -> float:
    psnr = quick_scores(render_split(trainer, cameras_of(views, views.test, CPU), 4096), views.test)["psnr"]
    return math.nan if psnr is None else psnr


@torch.no_grad()
def dead_share(trainer: Trainer) -> float:
    """Return the share of random points whose density no gradient reaches: it is clamped, or saturated in float32."""
    x = trainer.box.from_unit(torch.rand(PROBES, 3, generator=generator_for("dead share")))
    before, after = trainer.field.density_before_and_after(x)
    return float(at_an_end(before, after, trainer.field.density_limit).float().mean())


def at_an_end(
    before: Float[Tensor, " points"], after: Float[Tensor, " points"], limit: float
) -> Bool[Tensor, " points"]:
    return (before <= 0.0) | (after <= 0.0) | (before >= limit) | (after >= limit)
