"""One small view set and methods trained on it for a few seconds, for all cases that look at training itself."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from baselines.contract import Box, NetworkSize
from harness.batches import Batches
from harness.evaluate import cameras_of
from harness.ground_truth import read_views
from harness.lockstep import box_of, needs_view_direction
from harness.rays import Cameras
from harness.schedule import Budget
from harness.seeds import generator_for
from harness.settings import GridSettings, TrainSettings
from harness.speed.drawn_views import write_disc
from harness.stability.situation import Situation
from harness.trainer import Trainer
from scenes.view_set import ViewSet

SCENE = "lego"
STREAM = "stability/small"
CPU = torch.device("cpu")
PROBES = 4096
"""Random points of the box at which the amplifier is looked at."""


@dataclass(frozen=True)
class Setup:
    """What every small training has in common."""

    views: ViewSet
    batches: Batches
    test: Cameras
    settings: TrainSettings
    steps: int


@dataclass
class History:
    """A method after its training, and what was noted on the way."""

    trainer: Trainer
    losses: list[float] = field(default_factory=list)
    """Of each step's batch."""
    dead: list[tuple[int, float]] = field(default_factory=list)
    """(step, share of points whose density the amplifier's clamp holds at its end, so that no gradient passes)."""


def not_made_of_parts(method: str) -> str | None:
    """Why cases about encoding, amplifier and network have nothing to try there; None where they have."""
    from baselines.catalog import CATALOG

    parts = CATALOG[method].parts
    return None if parts is not None else "no encoding, amplifier or network: a grid of values"


@cache
def setup(situation: Situation) -> Setup:
    """A rendered scene at 64 pixels and a 6 × 64 network; a drawn disc and a smaller one with `quick`."""
    from harness.runner import view_set_folders

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
    situation: Situation, method: str, settings: TrainSettings | None = None, box: Box | None = None
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
    situation: Situation,
    trainer: Trainer,
    steps: int | None = None,
    on_step: Callable[[History], None] | None = None,
    batches: Batches | None = None,
) -> History:
    """To the end of its budget, or for `steps`. Raises `Diverged`."""
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
def trained(situation: Situation, method: str) -> History:
    """The method with its usual settings, trained once and never changed: cases work on copies."""
    every = 1 if situation.quick else 10

    def look(history: History) -> None:
        if history.trainer.step % every == 0 or history.trainer.step == 1:
            history.dead.append((history.trainer.step, dead_share(history.trainer)))

    return train(situation, new_trainer(situation, method), on_step=look)


@torch.no_grad()
def dead_share(trainer: Trainer) -> float:
    """Share of random points of the box whose density lies at an end of its range, where no gradient passes: clamped
    by the amplifier, or at the end of a sigmoid or softplus in float32.
    """
    x = trainer.box.from_unit(torch.rand(PROBES, 3, generator=generator_for("dead share")))
    before, after = trainer.field.density_before_and_after(x)
    return float(at_an_end(before, after, trainer.field.density_limit).float().mean())


def at_an_end(
    before: Float[Tensor, " points"], after: Float[Tensor, " points"], limit: float
) -> Bool[Tensor, " points"]:
    return (before <= 0.0) | (after <= 0.0) | (before >= limit) | (after >= limit)
