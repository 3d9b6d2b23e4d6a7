"""Question 3: how much sooner a PSNR is reached than by the plain training of the paper's network.

Every training is on its own clock, which evaluation does not touch, with the same batches, first weights and threads.
"""

import math
import statistics
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

from baselines.contract import Accelerations, Rays
from baselines.plain import PlainField, plain_loss, plain_render, plain_step
from harness.machine.device import keep_freed_memory, return_freed_memory
from harness.machine.stopwatch import Stopwatch
from harness.plan.profiles import Plan
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.plan.settings import TrainSettings
from harness.records.study import Check, Series
from harness.studies.speed.speed_context import (
    SCENES,
    STREAM,
    SpeedContext,
    batches_of,
    measured,
    not_measured,
    paper_settings,
    reduced_plan,
    views_of,
)
from harness.training.batches import Batches
from harness.training.evaluate import cameras_of, floor_psnr
from harness.training.lockstep import box_of, needs_view_direction
from harness.training.trainer import Diverged, Trainer
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import ViewSet


@dataclass
class PsnrCurve:
    """The evaluations of one training, in the order of its own clock."""

    seconds: list[float] = field(default_factory=list)
    psnr: list[float] = field(default_factory=list)
    """PSNR in dB."""
    before: float = -math.inf
    """The PSNR of the first weights in dB: a target below it says nothing about training."""
    ended: str = ""
    """The reason for its end, if that was not its budget."""

    def add(self, seconds: float, psnr: float) -> None:
        self.seconds.append(seconds)
        self.psnr.append(psnr)


@dataclass(frozen=True)
class Target:
    """The best that the plain training had reached at a share of its budget, and when it first did."""

    share: float
    psnr: float
    seconds: float


def targets_of(plain: PsnrCurve, shares: tuple[float, ...]) -> list[Target]:
    """Return one target per share, from evaluations that are evenly spread over the budget. A share before the first
    evaluation takes that one.
    """
    found = []
    for share in shares:
        count = max(1, round(share * len(plain.psnr)))
        best = max(range(count), key=lambda index: plain.psnr[index])
        found.append(Target(share, plain.psnr[best], plain.seconds[best]))
    return found


def reached(curve: PsnrCurve, target: float) -> float | None:
    """Return the seconds at which `target` is reached, or None.

    It counts once the next evaluation holds it too. Between an evaluation below and one above, PSNR is taken to be
    linear in log seconds; a first evaluation that is above already counts with its own seconds.
    """
    for index in range(len(curve.psnr) - 1):
        above, next_one = curve.psnr[index], curve.psnr[index + 1]
        if above < target or next_one < target:
            continue
        if index == 0:
            return curve.seconds[index]
        below = curve.psnr[index - 1]  # it is: were it not, the search would have ended there
        share = (target - below) / (above - below)
        first, second = math.log(curve.seconds[index - 1]), math.log(curve.seconds[index])
        return math.exp(first + share * (second - first))
    return None


def evaluation_times(first: float, growth: float = 1.06) -> Iterator[float]:
    """Yield the seconds at which to evaluate: each a constant factor after the one before, so that a crossing is found
    within that factor.
    """
    due = first
    while True:
        yield due
        due *= growth


def even_times(budget: float, count: int) -> list[float]:
    """Return `count` seconds, the last of which is the budget."""
    return [budget * (index + 1) / count for index in range(count)]


TEST_PIXELS = 4096
EVALUATIONS = 12
"""The number of evaluations of the plain training."""
SHARES = (1.0, 0.5, 0.25)
"""The shares of the plain training's budget: the first is the headline, the others show how a ratio depends on the
target.
"""
SEEDS = 3
"""The seeds of the reduced settings, which are cheap to repeat."""


@dataclass(frozen=True)
class PixelSubset:
    """A fixed random subset of the pixels of all test views."""

    rays: Rays
    colours: Tensor
    """Colours [pixels, 3], display colour over white."""

    def psnr(self, colours: Tensor) -> float:
        """Return the PSNR in dB of the mean squared error over all pixels."""
        error = torch.mean((colours.double() - self.colours.double()) ** 2)
        return float(-10.0 * torch.log10(error.clamp(min=1e-10)))


def examination_of(views: ViewSet, device: torch.device, pixels: int = TEST_PIXELS) -> PixelSubset:
    cameras = cameras_of(views, views.test, device)
    size = views.width * views.height
    count = len(cameras) * size
    index = torch.randperm(count, generator=generator_for("speed", "test pixels"))[: min(pixels, count)].sort().values
    colours = torch.as_tensor(over_white(views.test.rgba.pixels(index.numpy())), dtype=torch.float32)
    index = index.to(device)
    return PixelSubset(
        cameras.rays(index // size, index % views.width, index % size // views.width), colours.to(device)
    )


@runtime_checkable
class TimedTrainer(Protocol):
    """A training that can be evaluated on its way."""

    @property
    def seconds(self) -> float:
        """Return the seconds on its own clock."""
        ...

    def step(self) -> None:
        """Run one step. Raises `Diverged`."""
        ...

    def colours(self, rays: Rays) -> Tensor: ...


class Plain:
    """Plain training as anyone would write it: 64 stratified samples from near to far, constant learning rate."""

    def __init__(self, settings: TrainSettings, views: ViewSet, batches: Batches, device: torch.device) -> None:
        field = PlainField(settings.network, box_of(views, device), f"{STREAM}/coarse", needs_view_direction(views))
        self.field = field.to(device)
        self.optimiser = torch.optim.Adam(self.field.parameters(), lr=settings.learning_rate)
        self.settings = settings
        self.batches = batches
        self.clock = Stopwatch(device)
        self.steps = 0
        # allocations, outside the clock
        plain_loss(self.field, *batches.batch(STREAM, 0, settings.rays), settings.bins, None).backward()

    @property
    def seconds(self) -> float:
        return self.clock.seconds

    def step(self) -> None:
        rays, colours = self.batches.batch(STREAM, self.steps, self.settings.rays)
        jitter = generator_for(STREAM, self.steps, "jitter")
        with self.clock.running():
            plain_step(self.field, self.optimiser, rays, colours, self.settings.bins, jitter)
        self.steps += 1

    @torch.no_grad()
    def colours(self, rays: Rays) -> Tensor:
        white, chunk = _white(rays.origins.device), 128
        parts = [rays.part(start, start + chunk) for start in range(0, len(rays), chunk)]
        return torch.cat([plain_render(self.field, part, self.settings.bins, white, None) for part in parts])


class Accelerated:
    """The harness's trainer."""

    def __init__(
        self,
        settings: TrainSettings,
        budget: Budget,
        views: ViewSet,
        batches: Batches,
        device: torch.device,
        seed: str,
        chunk: int,
    ) -> None:
        directed = needs_view_direction(views) or not settings.accelerations.directions
        self.trainer = Trainer("nerf", box_of(views, device), settings, budget, seed, device, directed)
        self.batches, self.seed, self.chunk = batches, seed, chunk
        self.trainer.warm_up(*batches.batch(seed, 0, settings.rays))

    @property
    def seconds(self) -> float:
        return self.trainer.clock.seconds

    def step(self) -> None:
        self.trainer.train_on(*self.batches.batch(self.seed, self.trainer.step, self.trainer.settings.rays))

    def colours(self, rays: Rays) -> Tensor:
        return self.trainer.render(rays, self.chunk).colour


def follow(
    contestant: TimedTrainer,
    examination: PixelSubset,
    times: Iterable[float],
    until: Callable[[PsnrCurve], bool],
) -> PsnrCurve:
    """Train, evaluate whenever one of `times` (seconds, rising) has passed, and stop after the last or when `until`
    says so. A training that diverges ends its curve, which says why.
    """
    curve = PsnrCurve(before=examination.psnr(contestant.colours(examination.rays)))
    try:
        for due in times:
            if contestant.seconds >= due:  # one step took longer than the space between two evaluations
                continue
            while contestant.seconds < due:
                contestant.step()
            psnr = examination.psnr(contestant.colours(examination.rays))
            if not math.isfinite(psnr):
                curve.ended = f"colours not finite after {contestant.seconds:.1f} s"
                break
            curve.add(contestant.seconds, psnr)
            if until(curve):
                break
    except Diverged as stop:
        curve.ended = str(stop)
    return curve


def same_network(situation: SpeedContext, plan: Plan) -> TrainSettings:
    """Return the paper's network, learning rate and batch with every acceleration; the grid is updated as often as
    `reduced`'s.
    """
    settings = paper_settings(situation)
    return replace(
        settings,
        first_bins=settings.bins // 2,
        last_learning_rate=settings.learning_rate,
        grid=plan.train.grid,
        accelerations=Accelerations(),
    )


def measure(situation: SpeedContext) -> Iterator[Check | Series]:
    """Measure scene by scene, so that a run that is stopped keeps the scenes that were finished."""
    ratios: dict[str, dict[str, float | None]] = {name: {} for name in WORDS}
    for scene in SCENES:
        yield from _scene(situation, scene, ratios)
    for name, title in WORDS.items():
        values = [ratio for ratio in ratios[name].values() if ratio is not None]
        late = sorted(scene for scene, ratio in ratios[name].items() if ratio is None)
        target = _goal(situation, name)
        id, words = f"target.{name}.ratio", f"{title}: sooner than plain, median of {len(ratios[name])} scenes"
        if len(values) == len(ratios[name]):
            yield measured(id, words, values, "×", target=target, detail="one ratio a scene")
        else:
            why = f"no ratio for {', '.join(late)}: not reached in time, or shown before any training"
            yield not_measured(id, words, "×", why, target=target)


WORDS = {"same": "Same network", "reduced": "Settings of the reduced profile"}


def _goal(situation: SpeedContext, name: str) -> float | None:
    return situation.target(15.0, 7.5) if name == "same" else situation.target(100.0, 50.0)


def _scene(situation: SpeedContext, scene: str, ratios: dict[str, dict[str, float | None]]) -> Iterator[Check | Series]:
    views, device = views_of(situation, scene), situation.device
    plan, settings = reduced_plan(situation, scene), paper_settings(situation, "float32")
    batches, examination = batches_of(views, device), examination_of(views, device)
    budget = situation.plain_seconds
    situation.show.line(f"  {scene}: plain training for {budget:g} s")
    return_freed_memory()
    plain = follow(
        Plain(settings, views, batches, device), examination, even_times(budget, EVALUATIONS), lambda curve: False
    )
    keep_freed_memory()
    if not plain.psnr:
        for name, title in WORDS.items():
            ratios[name][scene] = None
            yield not_measured(f"target.{name}.{scene}", f"{title}, {scene}", "×", f"plain: {plain.ended}")
        return
    targets = targets_of(plain, SHARES)
    highest = max(target.psnr for target in targets)
    situation.show.line(f"  {scene}: plain reached {highest:.2f} dB after {targets[0].seconds:.0f} s")

    def done(curve: PsnrCurve) -> bool:
        return reached(curve, highest) is not None

    def contest(name: str, seed: str) -> PsnrCurve:
        chosen = same_network(situation, plan) if name == "same" else plan.train
        chosen_budget = Budget(None, budget) if name == "same" else plan.budget
        runner = Accelerated(chosen, chosen_budget, views, batches, device, seed, plan.score.chunk)
        expected = budget / (_goal(situation, name) or 100.0)
        times = (due for due in evaluation_times(expected / 20))
        curve = follow(runner, examination, _up_to(times, budget), done)
        seconds = reached(curve, highest)
        after = f"after {seconds:.2f} s" if seconds else f"not within {runner.seconds:.0f} s {curve.ended}"
        situation.show.line(f"  {scene}: {WORDS[name].lower()}, {highest:.2f} dB {after}")
        return curve

    curves = {"same": [contest("same", STREAM)], "reduced": [contest("reduced", STREAM)]}
    if done(curves["reduced"][0]) and not situation.quick:  # one that is late once need not be late three times
        curves["reduced"] += [contest("reduced", f"speed/{seed}") for seed in range(1, SEEDS)]
    floor = floor_psnr(views)
    for name in WORDS:
        for target in targets:
            figure = _ratio(situation, scene, name, target, curves[name], floor)
            if target.share == 1.0:
                ratios[name][scene] = figure.value
            yield figure
    yield _series(scene, "plain float32", plain)
    for name, title in WORDS.items():
        yield _series(scene, title.lower(), curves[name][0])


def _up_to(times: Iterable[float], last: float) -> Iterator[float]:
    """Yield `times` below `last`, and `last`."""
    for due in times:
        if due >= last:
            break
        yield due
    yield last


def _ratio(
    situation: SpeedContext, scene: str, name: str, target: Target, curves: list[PsnrCurve], floor: float | None
) -> Check:
    """Return the seconds of the plain training over those of the other; without a value as soon as one seed is late."""
    headline = target.share == 1.0
    id = f"target.{name}.{scene}" + ("" if headline else f".at{round(100 * target.share)}")
    title = f"{WORDS[name]}, {scene}, at plain's best after {target.share:.0%} of its time"
    goal = _goal(situation, name) if headline else None
    below = floor is not None and target.psnr < floor
    words = f"{target.psnr:.2f} dB, plain after {target.seconds:.1f} s"
    if below:
        words += f"; copying the nearest training view gives {floor:.2f} dB, so this target means little"
    found = [reached(curve, target.psnr) for curve in curves]
    if any(curve.before >= target.psnr for curve in curves):
        why = f"{words}; the first weights show as much without any training, so there is nothing to compare"
        return not_measured(id, title, "×", why, target=goal, repeats=len(curves))
    late = [curve for curve, seconds in zip(curves, found, strict=True) if seconds is None]
    if late:
        best = max((max(curve.psnr, default=0.0) for curve in late), default=0.0)
        ended = next((f" ({curve.ended})" for curve in late if curve.ended), "")
        why = f"{words}; {len(late)} of {len(curves)} did not reach it in time, best {best:.2f} dB{ended}"
        return not_measured(id, title, "×", why, target=goal, repeats=len(curves))
    seconds = [one for one in found if one is not None]
    detail = f"{words}, this after {statistics.median(seconds):.2f} s; {situation.threads} threads each"
    return measured(id, title, [target.seconds / one for one in seconds], "×", target=goal, detail=detail)


def _series(scene: str, name: str, curve: PsnrCurve) -> Series:
    return Series(
        panel=f"PSNR against training seconds, {scene}",
        item=0,
        name=name,
        x_label="training seconds",
        y_label="PSNR of test pixels (dB)",
        x=list(curve.seconds),
        y=list(curve.psnr),
        log_x=True,
        log_y=False,
    )


def _white(device: torch.device) -> Tensor:
    return torch.ones(3, device=device)
