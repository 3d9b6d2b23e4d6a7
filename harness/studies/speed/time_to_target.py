"""Question 3: how much sooner a PSNR is reached than by the plain training of the paper's network.

Every training has a clock that stands still during evaluations, and the same batches, initial weights and threads.
"""

import math
import statistics
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import accumulate, pairwise, repeat, takewhile
from operator import mul

import torch
from torch import Tensor

from baselines.contract import Rays
from baselines.plain import PlainField, plain_loss, plain_render, plain_step
from harness.machine.device import keep_freed_memory, return_freed_memory
from harness.machine.stopwatch import Stopwatch
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import TrainSettings
from harness.records.study import Check, Series
from harness.studies.speed.speed_context import (
    SCENE,
    STREAM,
    TEST_PIXELS,
    SpeedContext,
    batches_of,
    figure,
    no_figure,
    paper_settings,
    reduced_plan,
    same_network,
    views_of,
)
from harness.training.batches import Batch
from harness.training.learner import Job, Stepped, train, warm_up
from harness.training.lockstep import box_of, needs_view_direction
from harness.training.scoring.evaluate import cameras_of, floor_psnr
from harness.training.trainer import Diverged, Trainer
from harness.verdicts.survival import first_reached
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import ViewSet

EVALUATIONS = 12
"""The number of evaluations of the plain training."""
GROWTH = 1.06
"""The factor between the seconds of two evaluations of the others, within which a crossing is found."""
SHARES = (1.0, 0.5, 0.25)
"""The shares of the plain training's budget that give targets; the first is the headline."""
SEEDS = 3
"""The seeds of the reduced settings, which are cheap to repeat."""
WORDS = {"same": "Same network", "reduced": "Settings of the reduced profile"}
GOALS = {"same": (15.0, 7.5), "reduced": (100.0, 50.0)}
"""The ratios to reach, with matrix units and without."""


@dataclass
class PsnrCurve:
    """The evaluations of one training, in the order of its own clock; PSNR in dB."""

    seconds: list[float] = field(default_factory=list)
    psnr: list[float] = field(default_factory=list)
    before: float = -math.inf
    """The PSNR of the initial weights: a target below it says nothing about training."""
    ended: str = ""
    """Why the training ended before its budget; empty if it did not."""


@dataclass(frozen=True)
class Target:
    """The best PSNR of the plain training within a share of its budget, and when it was first reached."""

    share: float
    psnr: float
    seconds: float


def targets_of(plain: PsnrCurve, shares: tuple[float, ...]) -> list[Target]:
    """Return one target per share of the budget; a share that ends before the first evaluation takes the first."""
    targets = []
    for share in shares:
        best = max(range(max(1, round(share * len(plain.psnr)))), key=lambda index: plain.psnr[index])
        targets.append(Target(share, plain.psnr[best], plain.seconds[best]))
    return targets


def seconds_to(curve: PsnrCurve, target: float) -> float | None:
    """Return the seconds at which `target` is reached, or None.

    It is reached if the next evaluation is not below it either. Between an evaluation below and one above, PSNR is
    taken to be linear in log seconds; if the first evaluation is above already, its own seconds count.
    """
    points = list(zip(curve.seconds, curve.psnr, strict=True))
    for index, ((_, psnr), (_, after)) in enumerate(pairwise(points)):
        if min(psnr, after) >= target:
            return first_reached(points[max(0, index - 1) : index + 1], target)[0]
    return None


@dataclass(frozen=True)
class PixelSubset:
    """A fixed random subset of the pixels of all test views."""

    rays: Rays
    colours: Tensor
    """The display colours over white [pixels, 3]."""

    def psnr(self, colours: Tensor) -> float:
        error = torch.mean((colours.double() - self.colours.double()) ** 2)
        return float(-10.0 * torch.log10(error.clamp(min=1e-10)))


def pixels_of(views: ViewSet, device: torch.device, pixels: int = TEST_PIXELS) -> PixelSubset:
    cameras = cameras_of(views, views.test, device)
    size = views.width * views.height
    count = len(cameras) * size
    index = torch.randperm(count, generator=generator_for("speed", "test pixels"))[: min(pixels, count)].sort().values
    colours = torch.as_tensor(over_white(views.test.rgba.pixels(index.numpy())), dtype=torch.float32)
    index = index.to(device)
    return PixelSubset(
        cameras.rays(index // size, index % views.width, index % size // views.width), colours.to(device)
    )


class Plain:
    """The usual training: stratified samples from near to far, constant learning rate."""

    progress = 0.0

    def __init__(self, settings: TrainSettings, views: ViewSet, first: Batch, device: torch.device) -> None:
        plain = PlainField(settings.network, box_of(views, device), f"{STREAM}/coarse", needs_view_direction(views))
        self.field = plain.to(device)
        self.optimiser = torch.optim.Adam(self.field.parameters(), lr=settings.learning_rate)
        self.settings = settings
        self.clock = Stopwatch(device)
        self.step = 0
        # allocates, off the clock
        plain_loss(self.field, first.rays, first.colours, settings.bins, None).backward()

    def train_on(self, rays: Rays, colours: Tensor) -> None:
        jitter = generator_for(STREAM, self.step, "jitter")
        with self.clock.running():
            plain_step(self.field, self.optimiser, rays, colours, self.settings.bins, jitter)
        self.step += 1

    @torch.no_grad()
    def colours(self, rays: Rays) -> Tensor:
        white, chunk = torch.ones(3, device=rays.origins.device), 128
        parts = [rays.part(start, start + chunk) for start in range(0, len(rays), chunk)]
        return torch.cat([plain_render(self.field, part, self.settings.bins, white, None) for part in parts])


def follow(
    learner: Stepped,
    batch_at: Callable[[int], Batch],
    colours_of: Callable[[Rays], Tensor],
    pixels: PixelSubset,
    times: Iterable[float],
    target: float = math.inf,
) -> PsnrCurve:
    """Train and evaluate after each of `times` (seconds), until the last, `target`, or divergence, which is noted."""
    curve = PsnrCurve(before=pixels.psnr(colours_of(pixels.rays)))
    try:
        for due in times:
            if learner.clock.seconds >= due:  # a step took longer than the time between two evaluations
                continue
            train(learner, batch_at, lambda stepped: stepped.clock.seconds >= due)  # noqa: B023
            psnr = pixels.psnr(colours_of(pixels.rays))
            if not math.isfinite(psnr):
                curve.ended = f"colours not finite after {learner.clock.seconds:.1f} s"
                break
            curve.seconds.append(learner.clock.seconds)
            curve.psnr.append(psnr)
            if seconds_to(curve, target) is not None:
                break
    except Diverged as stop:
        curve.ended = str(stop)
    return curve


def measure(context: SpeedContext) -> Iterator[Check | Series]:
    views, device, budget = views_of(context), context.device, context.plain_seconds
    plan, settings = reduced_plan(context), paper_settings(context, "float32")
    batches, pixels = batches_of(views, device), pixels_of(views, device)
    context.show.line(f"  plain training for {budget:g} s")
    return_freed_memory()
    batch_at = batches.stream(STREAM, settings.rays)
    learner = Plain(settings, views, batch_at(0), device)
    times = [budget * (index + 1) / EVALUATIONS for index in range(EVALUATIONS)]
    plain = follow(learner, batch_at, learner.colours, pixels, times)
    keep_freed_memory()
    if not plain.psnr:
        for name, title in WORDS.items():
            yield no_figure(f"target.{name}.ratio", title, "×", f"plain: {plain.ended}")
        return
    targets = targets_of(plain, SHARES)
    highest = max(target.psnr for target in targets)
    context.show.line(f"  plain reached {highest:.2f} dB after {targets[0].seconds:.0f} s")

    directed, box = needs_view_direction(views), box_of(views, device)
    sides = {"same": (same_network(context, plan), Budget(None, budget)), "reduced": (plan.train, plan.budget)}

    def contest(name: str, seed: str) -> PsnrCurve:
        settings, until = sides[name]
        trainer = Trainer(Job("nerf", box, settings, until, seed, device, directed))
        batch_at = batches.stream(seed, settings.rays)
        warm_up(trainer, batch_at)
        first = budget / (context.target(*GOALS[name]) or 100.0) / 20
        times = takewhile(lambda due: due < budget, accumulate(repeat(GROWTH), mul, initial=first))

        def colours_of(rays: Rays) -> Tensor:
            with trainer.averaged():
                return trainer.render(rays, plan.score.chunk).colour

        curve = follow(trainer, batch_at, colours_of, pixels, [*times, budget], highest)
        seconds = seconds_to(curve, highest)
        after = f"after {seconds:.2f} s" if seconds else f"not within {trainer.clock.seconds:.0f} s {curve.ended}"
        context.show.line(f"  {WORDS[name].lower()}, {highest:.2f} dB {after}")
        return curve

    curves = {name: [contest(name, STREAM)] for name in WORDS}
    # a side that does not reach the target once is not repeated
    if seconds_to(curves["reduced"][0], highest) is not None and not context.quick:
        curves["reduced"] += [contest("reduced", f"speed/{seed}") for seed in range(1, SEEDS)]
    floor = floor_psnr(views)
    for name in WORDS:
        for target in targets:
            yield ratio_to(context, name, target, curves[name], floor)
    for name, curve in {"plain float32": plain, **{WORDS[name].lower(): curves[name][0] for name in WORDS}}.items():
        panel, y_label = f"PSNR against training seconds, {SCENE}", "PSNR of test pixels (dB)"
        yield Series(panel, 0, name, "training seconds", y_label, curve.seconds, curve.psnr, log_y=False)


def ratio_to(context: SpeedContext, name: str, target: Target, curves: list[PsnrCurve], floor: float | None) -> Check:
    """Return the seconds of the plain training over those of the other; without a value if any seed is late."""
    headline = target.share == 1.0
    id = f"target.{name}." + ("ratio" if headline else f"at{round(100 * target.share)}")
    title = f"{WORDS[name]}, {SCENE}, at plain's best after {target.share:.0%} of its time"
    goal = context.target(*GOALS[name]) if headline else None
    words = f"{target.psnr:.2f} dB, plain after {target.seconds:.1f} s"
    if floor is not None and target.psnr < floor:
        words += f"; copying the nearest training view gives {floor:.2f} dB, so this target means little"
    seconds = [taken for curve in curves if (taken := seconds_to(curve, target.psnr)) is not None]
    why = ""
    if any(curve.before >= target.psnr for curve in curves):
        why = "the initial weights show as much without any training, so there is nothing to compare"
    elif len(seconds) < len(curves):
        late = [curve for curve in curves if seconds_to(curve, target.psnr) is None]
        best = max(max(curve.psnr, default=0.0) for curve in late)
        ended = next((f" ({curve.ended})" for curve in late if curve.ended), "")
        why = f"{len(late)} of {len(curves)} did not reach it in time, best {best:.2f} dB{ended}"
    if why:
        return no_figure(id, title, "×", f"{words}; {why}", low=goal, repeats=len(curves))
    detail = f"{words}, this after {statistics.median(seconds):.2f} s; {context.threads} threads each"
    return figure(id, title, [target.seconds / taken for taken in seconds], "×", detail, low=goal)
