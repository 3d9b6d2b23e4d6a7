"""Speed gates: seconds of a training step, of a rendered view and of its scores, in seconds of plain code that does the
same kind of work in turn with them in the same process and is never made faster: `baselines.plain`, and a filter.

A slower machine, or a busy one, is slower at both.
"""

import math
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import gaussian_filter
from scipy.stats import norm

from baselines.plain import PlainField, plain_render, plain_step
from harness.gate.gates import RENEWAL_PROCESSES, SLOWER_FOUND, SPEED_REPEATS, TRAINED_SCENES, Gate, gates
from harness.gate.limits import Limit
from harness.gate.outcome import GateContext, Sample
from harness.gate.process import in_child
from harness.gate.references import References
from harness.gate.worse import gate_plan
from harness.plan.seeds import generator_for
from harness.run_folder.folder_lock import scratch_folder
from harness.studies.drawn_views import write_disc
from harness.studies.speed.speed_context import interleaved, quotients
from harness.training import evaluate
from harness.training.batches import Batches
from harness.training.learner import Learner, at_step, take_step, train
from harness.training.lockstep import box_of
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet, read_view_set

STEPS_BEFORE = 80
"""The steps before the measurement: the occupancy grid is in use from then on."""
FILTERS = 20
STREAM = "speed"
CPU = torch.device("cpu")


def measure(situation: GateContext, gates: tuple[Gate, ...]) -> dict[str, Sample]:
    stored = situation.references
    found = in_child(ratios, tuple(gate.name for gate in gates), situation.out)
    return {
        name: Sample([ratio / centre_of(stored.speed[name])], limit=limit_of(stored.speed[name], stored.wider("speed")))
        for name, ratio in found.items()
        if name in stored.speed
    }


def renew(situation: GateContext) -> References:
    """Measure in several processes, one after another: where data lies in memory differs by process and is part of the
    spread.
    """
    names = tuple(gate.name for gate in gates() if gate.kind == "speed")
    found: dict[str, list[float]] = {name: [] for name in names}
    for number in range(RENEWAL_PROCESSES):
        for name, ratio in in_child(ratios, names, situation.out).items():
            found[name].append(float(f"{ratio:.5g}"))
        situation.show.line(f"speed: process {number + 1} of {RENEWAL_PROCESSES}")
    return replace(situation.references, speed=found)


def centre_of(ratios: list[float]) -> float:
    """Return their geometric mean."""
    return math.exp(statistics.fmean(map(math.log, ratios)))


def limit_of(ratios: list[float], wider: float = 1.0) -> Limit:
    """Return the limit half way, in logarithms, between what was stored and `SLOWER_FOUND` times that; `detects` is the
    factor found in nine of ten runs, by the spread between the processes of the renewal.
    """
    spread = statistics.stdev(map(math.log, ratios)) if len(ratios) > 1 else 0.0
    high = math.sqrt(SLOWER_FOUND) * wider
    return Limit(None, high, 1.0, spread, len(ratios), high * math.exp(float(norm.ppf(0.9)) * spread))


def ratios(names: tuple[str, ...], out: Path, clock: Callable[[], float] = time.perf_counter) -> dict[str, float]:
    """Return gate → median over the repetitions of seconds per seconds of the plain code."""
    with scratch_folder(out) as scratch:
        write_disc(scratch / "views", 40, 20, 2, seed=3)
        views = read_view_set(scratch / "views", scratch=scratch)
        return {name: ratio(*sides_of(name, views), clock) for name in names}


def ratio(
    side: Callable[[], object], plain: Callable[[], object], clock: Callable[[], float] = time.perf_counter
) -> float:
    """Return the median of repeated pairs: what disturbs the machine for a while disturbs both."""
    seconds = interleaved({"side": side, "plain": plain}, SPEED_REPEATS, least_seconds=0.02, clock=clock)
    return statistics.median(quotients(seconds["side"], seconds["plain"]))


def sides_of(name: str, views: ViewSet) -> tuple[Callable[[], object], Callable[[], object]]:
    """Return what the gate of that name measures and the plain code beside it, as functions."""
    what, _, method = name.removeprefix("speed.").partition(".")
    learner = trained(method or "nerf", views)
    cameras = evaluate.cameras_of(views, views.test, CPU)
    settings = gate_plan((0,), TRAINED_SCENES, (method,)).train
    field = PlainField(settings.network, box_of(views, CPU), STREAM)
    if what == "train":
        batch_at = Batches(evaluate.cameras_of(views, views.train, CPU), views.train.rgba).stream(STREAM, settings.rays)
        optimiser = torch.optim.Adam(field.parameters(), lr=settings.learning_rate)
        first = batch_at(0)

        def plain() -> None:
            plain_step(field, optimiser, *first, settings.bins, generator_for(STREAM, "plain"))

        return partial(take_step, learner, batch_at), plain
    if what == "render":
        rays, white = cameras.all_rays(0), torch.ones(3)
        without = torch.no_grad()(plain_render)
        return (
            lambda: evaluate.render_view(learner, cameras, 0, 2048),
            lambda: without(field, rays, settings.bins, white, None),
        )
    image = evaluate.render_view(learner, cameras, 0, 2048)
    clipped = replace(image, colour=np.clip(image.colour, 0.0, 1.0))

    def filtered() -> None:
        for _ in range(FILTERS):
            gaussian_filter(clipped.colour.astype(np.float64), (1.5, 1.5, 0))

    return lambda: evaluate.view_scores(clipped, views.test, 0), filtered


def trained(method: str, views: ViewSet) -> Learner:
    """Return a learner trained with the gate's settings, past the step from which the grid is in use."""
    plan = gate_plan((0,), TRAINED_SCENES, (method,))
    learner = Trainer(method, box_of(views, CPU), plan.train, plan.budget, STREAM, CPU)
    batches = Batches(evaluate.cameras_of(views, views.train, CPU), views.train.rgba)
    batch_at = batches.stream(STREAM, plan.train.rays)
    learner.warm_up(*batch_at(0))
    return train(learner, batch_at, at_step(STEPS_BEFORE))
