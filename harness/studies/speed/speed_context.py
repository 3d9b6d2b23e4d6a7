"""The context of the questions about speed: machine, scenes, trained fields, and the timing of two sides in turn."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache

import torch

from baselines.contract import Accelerations, Box, NetworkSize, Precision, Rays
from harness.execution.ground_truth import read_views, view_set_folders
from harness.machine.device import multiplies_bfloat16
from harness.plan.profiles import PROFILES
from harness.plan.run_plan import Plan
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, TrainSettings, ViewSettings
from harness.records.study import Check, check
from harness.studies.drawn_views import write_disc
from harness.studies.framework import Study, StudyContext
from harness.studies.speed.questions import QUICK_SECONDS
from harness.training.batches import Batch, Batches
from harness.training.learner import Job, at_step, train, warm_up
from harness.training.lockstep import box_of
from harness.training.scoring.evaluate import cameras_of
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet

SCENE = "lego"
DENSE = replace(Accelerations(), grid=False, clipping=False)
"""The accelerations that evaluate all samples of every ray."""
TEST_PIXELS = 4096
"""The number of test pixels from which a PSNR is estimated during training."""
STREAM = "speed/0"
"""The seed of every batch and every initial weight, the same for all sides of a comparison."""


@dataclass(frozen=True)
class SpeedContext(StudyContext):
    """Both sides of every comparison get all cores as threads."""

    plain_seconds: float

    def settings(self) -> dict[str, object]:
        plan = reduced_plan(self)
        return {
            "quick": self.quick,
            "publishable": not self.quick,
            "device": self.device.type,
            "threads": self.threads,
            "precision": self.precision,
            "matrix_units": self.matrix_units,
            "plain_seconds": self.plain_seconds,
            "test_pixels": TEST_PIXELS,
            "paper": asdict(paper_settings(self)),
            "same_network": asdict(same_network(self, plan)),
            "reduced": {"train": asdict(plan.train), "views": asdict(plan.views), "budget": plan.budget.settings()},
        }

    def seconds(self, study: Study, asked: list[Study]) -> float:
        return QUICK_SECONDS if self.quick else study.seconds

    @property
    def synchronise(self) -> Callable[[], object]:
        return torch.cuda.synchronize if self.device.type == "cuda" else lambda: None

    @property
    def precision(self) -> Precision:
        """Return the precision of matrix multiplications that `python -m harness run` would choose here."""
        return "bfloat16" if multiplies_bfloat16(self.device) else "float32"

    @property
    def matrix_units(self) -> bool:
        """Return whether the higher targets apply: on a CPU with AMX."""
        return self.device.type == "cpu" and self.precision == "bfloat16"

    def target(self, with_matrix_units: float, without: float) -> float | None:
        """Return the target; a GPU has none."""
        if self.device.type != "cpu":
            return None
        return with_matrix_units if self.matrix_units else without

    def repeats(self, usual: int) -> int:
        return 2 if self.quick else usual


def paper_settings(context: SpeedContext, precision: Precision | None = None) -> TrainSettings:
    """Return 8 × 256, colour 2 × 128, L = 10/4, 1024 rays of 64 samples, all evaluated."""
    usual = TrainSettings(
        fine_bins=0,
        first_bins=64,
        clip_norm=1e9,  # the plain step has no clipping
        clip_ratio=1e9,
        precision=precision or context.precision,
        grid=GridSettings(cells=0),
        accelerations=DENSE,
    )
    if not context.quick:
        return usual
    return replace(usual, network=NetworkSize(8, 32, 2, 16, 10, 4), rays=64, bins=8, first_bins=8)


def reduced_plan(context: SpeedContext) -> Plan:
    """Return the profile `reduced` on `SCENE`, at the precision of a run on this machine."""
    plan = replace(PROFILES["reduced"].without_extras(), scenes=(SCENE,), methods=("nerf",), seeds=(0,))
    plan = replace(plan, train=replace(plan.train, precision=context.precision))
    if not context.quick:
        return plan
    small = replace(
        plan.train,
        network=NetworkSize(6, 16, 2, 16, 6, 2),
        rays=64,
        bins=16,
        first_bins=12,
        grid=GridSettings(cells=8, first_step=5, every=5),
    )
    views = ViewSettings(resolution=16, train=6, val=0, test=3, spp_train=4, spp_test=4)
    return replace(plan, train=small, score=replace(plan.score, chunk=256), views=views)


def same_network(context: SpeedContext, plan: Plan) -> TrainSettings:
    """Return the paper's network, learning rate and batch with every acceleration, and the grid of `reduced`."""
    settings = paper_settings(context)
    return replace(
        settings,
        first_bins=settings.bins // 2,
        last_learning_rate=settings.learning_rate,
        grid=plan.train.grid,
        accelerations=Accelerations(),
    )


def batches_of(views: ViewSet, device: torch.device) -> Batches:
    return Batches(cameras_of(views, views.train, device), views.train.rgba)


@cache
def views_of(context: SpeedContext) -> ViewSet:
    """Return the view set of `SCENE` in the reduced profile, rendered if the cache lacks it; a drawn one if `quick`."""
    plan = reduced_plan(context)
    if context.quick:
        folder = context.scratch / f"{SCENE}-drawn"
        write_disc(folder, plan.views.resolution, plan.views.train, plan.views.test, seed=0)
    else:
        folder = view_set_folders(plan, context.view_sets, context.show)[SCENE]
    return read_views(folder, plan.views, context.scratch)


def random_batch(device: torch.device, count: int, *purpose: int | str) -> Batch:
    """Return `count` rays from all sides through the middle of the box ±1, near 2 and far 6, with random colours."""
    generator = generator_for(*purpose)
    origins = 4.0 * torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)
    aims = torch.rand(count, 3, generator=generator) - 0.5
    directions = torch.nn.functional.normalize(aims - origins, dim=-1)
    colours = torch.rand(count, 3, generator=generator)
    return Batch(Rays(origins, directions, 2.0, 6.0).to(device), colours.to(device))


def unit_box(device: torch.device) -> Box:
    return Box(-torch.ones(3, device=device), torch.ones(3, device=device))


Seconds = dict[str, list[float]]
"""Side → seconds per execution, one entry per repetition."""


def interleaved(
    sides: Mapping[str, Callable[[], object]],
    repeats: int,
    synchronise: Callable[[], object] = lambda: None,
    least_seconds: float = 0.0,
    clock: Callable[[], float] = time.perf_counter,
    before: Mapping[str, Callable[[], object]] | None = None,
) -> Seconds:
    """Return the seconds per execution of each side, A B A B …, after a round that does not count.

    A side that takes less than `least_seconds` is executed often enough to fill them, and the mean counts. `before`
    prepares a side, off the clock.
    """

    def timed(name: str, calls: int) -> float:
        synchronise()
        began = clock()
        for _ in range(calls):
            sides[name]()
        synchronise()
        return (clock() - began) / calls

    prepare = before or {name: lambda: None for name in sides}
    calls: dict[str, int] = {}
    for name, side in sides.items():
        prepare[name]()
        side()  # allocations, choices of kernels, caches
        calls[name] = max(1, round(least_seconds / max(timed(name, 1), 1e-9)))
    taken: Seconds = {name: [] for name in sides}
    for _ in range(repeats):
        for name in sides:
            prepare[name]()
            taken[name].append(timed(name, calls[name]))
    return taken


def quotients(slow: Sequence[float], fast: Sequence[float]) -> list[float]:
    """Return how many times faster, repetition by repetition: a busy machine slows both sides alike."""
    return [a / b for a, b in zip(slow, fast, strict=True)]


def figure(
    id: str,
    title: str,
    values: Sequence[float],
    unit: str,
    detail: str = "",
    *,
    low: float | None = None,
    high: float | None = None,
) -> Check:
    """Check the median of one or more repetitions against a target for this kind of machine, with their range."""
    spread, repeats = (min(values), max(values)), len(values)
    median = statistics.median(values)
    return check(title, median, low, high, unit, detail, owner="machine", spread=spread, repeats=repeats, id=id)


def ratio(
    id: str, title: str, slow: Sequence[float], fast: Sequence[float], detail: str = "", low: float | None = None
) -> Check:
    return figure(f"{id}.ratio", title, quotients(slow, fast), "×", detail, low=low)


def no_figure(id: str, title: str, unit: str, why: str, *, low: float | None = None, repeats: int = 0) -> Check:
    return check(title, None, low, unit=unit, why=why, owner="machine", repeats=repeats, id=id)


def new_trainer(
    context: SpeedContext, settings: TrainSettings, box: Box, view_dependent: bool = True, budget: Budget | None = None
) -> Trainer:
    """Return vanilla NeRF. Without a budget the learning rate is constant."""
    return Trainer(Job("nerf", box, settings, budget or Budget(None, None), STREAM, context.device, view_dependent))


def trained_reduced(context: SpeedContext) -> Trainer:
    """Return the reduced profile's NeRF on `SCENE`, trained without directions until empty space is skipped."""
    plan, views = reduced_plan(context), views_of(context)
    trainer = new_trainer(context, plan.train, box_of(views, context.device), False, plan.budget)
    batch_at = batches_of(views, context.device).stream(STREAM, plan.train.rays)
    warm_up(trainer, batch_at)
    return train(trainer, batch_at, at_step(plan.train.grid.first_step + (10 if context.quick else 300)))


def variant_of(source: Trainer, context: SpeedContext, accelerations: Accelerations) -> Trainer:
    """Return a copy in the same state with other accelerations. Weights of directions that the source lacks are zero,
    so that the copy renders the same.
    """
    settings = replace(source.settings, accelerations=accelerations)
    copy = new_trainer(context, settings, source.box, source.coarse.view_dependent, source.budget)
    weights = dict(source.fields.named_parameters())
    with torch.no_grad():
        for name, weight in copy.fields.named_parameters():
            weight.zero_()
            weight[..., : weights[name].shape[-1]] = weights[name]
    copy.step = source.step
    if copy.grid is not None and source.grid is not None:
        copy.grid.density = source.grid.density.clone()
        copy.grid.occupied = source.grid.occupied.clone()
    return copy
