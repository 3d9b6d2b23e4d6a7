"""One small view set and methods trained on it for a few seconds, for all cases that look at training itself.

The billboard failure is brought about on purpose: every training image painted in front of its own camera.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from baselines.contract import Box, NetworkSize
from harness.execution.ground_truth import read_views
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, TrainSettings, ViewSettings
from harness.studies.drawn_views import write_disc
from harness.studies.stability.stability_context import StabilityContext
from harness.training import evaluate
from harness.training.batches import Batches, Cameras
from harness.training.cell_training import warnings_of
from harness.training.evaluate import cameras_of
from harness.training.lockstep import box_of, needs_view_direction
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet

SCENE = "lego"
STREAM = "stability/small"
CPU = torch.device("cpu")
PROBES = 4096
"""The random points of the box at which the amplifier is evaluated."""


@dataclass(frozen=True)
class Setup:
    """The common setup of all small trainings."""

    views: ViewSet
    batches: Batches
    test: Cameras
    settings: TrainSettings
    steps: int


@dataclass
class History:
    """A method after its training, and what was recorded on the way."""

    trainer: Trainer
    losses: list[float] = field(default_factory=list)
    """The loss of each step's batch."""
    dead: list[tuple[int, float]] = field(default_factory=list)
    """Pairs (step, share of points whose density the amplifier's clamp holds at its end, so that no gradient
    passes).
    """


def not_made_of_parts(method: str) -> str | None:
    """Return why cases about encoding, amplifier and network do not apply to a method; None if they do."""
    from baselines.catalog import CATALOG

    parts = CATALOG[method].parts
    return None if parts is not None else "no encoding, amplifier or network: a grid of values"


@cache
def setup(situation: StabilityContext) -> Setup:
    """Return a rendered scene at 64 pixels and a 6 × 64 network; a drawn disc and a smaller one with `quick`."""
    from harness.execution.run import view_set_folders

    plan = replace(situation.plan("smoke", [SCENE]), methods=("nerf",))
    settings, steps = replace(plan.train, grid=GridSettings(cells=24, first_step=100, every=25)), 300
    if situation.quick:
        folder = situation.scratch / "small"
        write_disc(folder, plan.views.resolution, plan.views.train, plan.views.test, seed=0)
        small = replace(settings, network=NetworkSize(6, 16, 2, 16, 6, 2), rays=64, bins=12, first_bins=8)
        settings, steps = replace(small, grid=GridSettings(cells=8, first_step=4, every=4)), 12
        sizes = plan.views
    else:
        sizes = replace(plan.views, resolution=64, train=24, val=0, test=2)
        plan = replace(plan, views=sizes)
        folder = view_set_folders(plan, situation.view_sets, situation.show)[SCENE]
    views = read_views(folder, sizes, situation.scratch)
    batches = Batches(cameras_of(views, views.train, CPU), views.train.rgba)
    return Setup(views, batches, cameras_of(views, views.test, CPU), settings, steps)


def new_trainer(
    situation: StabilityContext, method: str, settings: TrainSettings | None = None, box: Box | None = None
) -> Trainer:
    here = setup(situation)
    return Trainer(
        method,
        box or box_of(here.views, CPU),
        settings or here.settings,
        Budget(here.steps, None),
        STREAM,
        CPU,
        needs_view_direction(here.views),
    )


def train(
    situation: StabilityContext,
    trainer: Trainer,
    steps: int | None = None,
    on_step: Callable[[History], None] | None = None,
    batches: Batches | None = None,
) -> History:
    """Train to the end of its budget, or for `steps`. Raises `Diverged`."""
    here, history = setup(situation), History(trainer)
    batches = batches or here.batches
    for _ in range(here.steps if steps is None else steps):
        trainer.train_on(*batches.batch(STREAM, trainer.step, trainer.settings.rays))
        assert trainer.last_loss is not None
        history.losses.append(trainer.last_loss)
        if on_step is not None:
            on_step(history)
    return history


@cache
def trained(situation: StabilityContext, method: str) -> History:
    """Return the method with its usual settings, trained once and never changed: cases work on copies."""
    every = 1 if situation.quick else 10

    def look(history: History) -> None:
        if history.trainer.step % every == 0 or history.trainer.step == 1:
            history.dead.append((history.trainer.step, dead_share(history.trainer)))

    return train(situation, new_trainer(situation, method), on_step=look)


@torch.no_grad()
def dead_share(trainer: Trainer) -> float:
    """Return the share of random points of the box whose density lies at an end of its range, where no gradient passes:
    clamped by the amplifier, or at the end of a sigmoid or softplus in float32.
    """
    x = trainer.box.from_unit(torch.rand(PROBES, 3, generator=generator_for("dead share")))
    before, after = trainer.field.density_before_and_after(x)
    return float(at_an_end(before, after, trainer.field.density_limit).float().mean())


def at_an_end(
    before: Float[Tensor, " points"], after: Float[Tensor, " points"], limit: float
) -> Bool[Tensor, " points"]:
    return (before <= 0.0) | (after <= 0.0) | (before >= limit) | (after >= limit)


FEW_VIEWS = 6
STEPS = 200
FOG = 20.0
"""The offset added to every raw density at the start: softplus of it is opaque within a bin, so the first bin is all
that is seen, and no gradient reaches what lies behind. A density without a bias, scaled up, starts like that.
"""


@dataclass(frozen=True)
class Painted:
    """The result of a training with a planted billboard."""

    train: float
    """The PSNR of the training views, dB."""
    test: float
    floor: float
    """The PSNR of copies of the nearest training view."""
    depth: float
    """The median over the test views, scene units."""
    near: float
    """The distance at which rays begin."""
    warnings: list[str]


def planted_billboard(folder: Path, views: ViewSettings, train: TrainSettings, scratch: Path, steps: int) -> Painted:
    """Train `nerf` on a few views of the set in `folder`, with fog before every camera at the start.

    Rays run from near to far, as in the original: cut to a box that all cameras share, they would have to share what
    is painted on it as well.
    """
    seen = read_views(folder, replace(views, train=FEW_VIEWS), scratch)
    settings = replace(
        train,
        accelerations=train.accelerations.without(("clipping", "grid", "early_stop")),
        grid=replace(train.grid, cells=0),
    )
    device = torch.device("cpu")
    batches = Batches(evaluate.cameras_of(seen, seen.train, device), seen.train.rgba)
    learner = Trainer("nerf", box_of(seen, device), settings, Budget(steps, None), "billboard", device)
    with torch.no_grad():
        learner.coarse.density_head.bias.add_(FOG)
    while learner.progress < 1.0:
        learner.train_on(*batches.batch("billboard", learner.step, settings.rays))
    images = list(evaluate.render_split(learner, evaluate.cameras_of(seen, seen.test, device), chunk=4096))
    scores = {
        "psnr": evaluate.quick_scores(images, seen.test)["psnr"],
        "psnr_train": evaluate.train_psnr(learner, seen, FEW_VIEWS, chunk=4096),
        "psnr_floor": evaluate.floor_psnr(seen),
    }
    opacity = float(np.mean([image.opacity.mean() for image in images]))
    return Painted(
        train=scores["psnr_train"] or 0.0,
        test=scores["psnr"] or 0.0,
        floor=scores["psnr_floor"] or 0.0,
        depth=float(np.median([image.depth for image in images])),
        near=seen.near,
        warnings=warnings_of(scores, opacity, grid_emptied=False),
    )
