"""Speed gates: seconds of a training step, of a rendered view and of its scores, relative to plain code.

The plain code is `baselines.plain` and the parts of a score that other libraries compute. It does the same kind of
work, alternates with the measured code in one process, and is never made faster. A slower or busier machine slows down
both. Their use of a processor's instructions differs, so quotients are compared within a class of processors.
"""

import math
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from msgspec import structs
from scipy.special import ndtri

from baselines.plain import PlainField, plain_render, plain_step
from harness.gate.gate_context import GateContext, complete
from harness.gate.gates import RENEWAL_PROCESSES, SLOWER_FOUND, SPEED_REPEATS, STEPS, gates
from harness.gate.limits import Limit, judge, unfit
from harness.gate.quality.short_trainings import TRAIN
from harness.machine.processor_class import class_here
from harness.machine.stopping import in_child
from harness.plan.schedule import Budget
from harness.plan.seeds import generator_for
from harness.records.study import Check
from harness.studies.drawn_views import disc_views
from harness.studies.speed.speed_context import interleaved, quotients
from harness.training.batches import Batches
from harness.training.learner import Job, at_step, take_step, train, warm_up
from harness.training.lockstep import box_of
from harness.training.scoring import evaluate
from harness.training.trainer import Trainer
from scenes.view_sets.view_set import ViewSet

STEPS_BEFORE = 80
"""The steps before the measurement, after which the occupancy grid is in use."""
STREAM = "speed"
CPU = torch.device("cpu")


@complete("speed")
def measure(context: GateContext) -> Iterator[Check]:
    chosen, here = context.of_kind("speed"), class_here()
    stored = context.references.speed.get(here)
    why = unfit("speed", {"speed": stored.facts}) if stored else ""
    known = {name: stored.gates[name] for name in chosen if name in stored.gates} if stored and not why else {}
    for name, quotient in (in_child(ratios, tuple(known)) if known else {}).items():
        yield judge(chosen[name], [quotient / statistics.geometric_mean(known[name])], limit_of(known[name]))
    for name in chosen.keys() - known.keys():
        missing = f"no reference of processors of class {here}; `python -m harness gate --renew --only speed` makes one"
        check = judge(chosen[name], [], why or missing)
        yield check if why else structs.replace(check, status="not_available")


def renew(context: GateContext) -> dict[str, list[float]]:
    """Return each gate's quotients from several processes: the placement of data in memory is part of the spread."""
    names = tuple(gate.name for gate in gates() if gate.kind == "speed")
    speed: dict[str, list[float]] = {name: [] for name in names}
    for number in range(RENEWAL_PROCESSES):
        for name, quotient in in_child(ratios, names).items():
            speed[name].append(float(f"{quotient:.5g}"))
        context.show.line(f"speed: process {number + 1} of {RENEWAL_PROCESSES}")
    return speed


def limit_of(ratios: list[float]) -> Limit:
    """Return the limit half way, in logarithms, between the stored value and `SLOWER_FOUND` times it; `detects` is the
    factor that nine of ten runs find, by the spread between the processes of the renewal.
    """
    spread = statistics.stdev(map(math.log, ratios)) if len(ratios) > 1 else 0.0
    high = math.sqrt(SLOWER_FOUND)
    return Limit(None, high, 1.0, spread, len(ratios), high * math.exp(float(ndtri(0.9)) * spread))


def ratios(names: tuple[str, ...]) -> dict[str, float]:
    """Return gate → median over repetitions of its seconds divided by those of the plain code."""
    views = disc_views(40, 20, 2, seed=3)
    return {name: ratio(*sides_of(name, views)) for name in names}


def ratio(
    side: Callable[[], object], plain: Callable[[], object], clock: Callable[[], float] = time.perf_counter
) -> float:
    seconds = interleaved({"side": side, "plain": plain}, SPEED_REPEATS, least_seconds=0.02, clock=clock)
    return statistics.median(quotients(seconds["side"], seconds["plain"]))


def sides_of(name: str, views: ViewSet) -> tuple[Callable[[], object], Callable[[], object]]:
    """Return two functions: the code that the gate of that name measures, and the plain code."""
    what, _, method = name.removeprefix("speed.").partition(".")
    batch_at = Batches(evaluate.cameras_of(views, views.train, CPU), views.train.rgba).stream(STREAM, TRAIN.rays)
    learner = Trainer(Job(method or "nerf", box_of(views, CPU), TRAIN, Budget(STEPS, None), STREAM, CPU))
    warm_up(learner, batch_at)
    train(learner, batch_at, at_step(STEPS_BEFORE))  # the grid is then in use
    cameras = evaluate.cameras_of(views, views.test, CPU)
    field = PlainField(TRAIN.network, box_of(views, CPU), STREAM)
    if what == "train":
        optimiser = torch.optim.Adam(field.parameters(), lr=TRAIN.learning_rate)
        first = batch_at(0)

        def plain() -> None:
            plain_step(field, optimiser, first.rays, first.colours, TRAIN.bins, generator_for(STREAM, "plain"))

        return partial(take_step, learner, batch_at), plain
    if what == "render":
        rays, white = cameras.all_rays(0), torch.ones(3)
        without = torch.no_grad()(plain_render)
        return (
            lambda: evaluate.render_view(learner, cameras, 0, 2048),
            lambda: without(field, rays, TRAIN.bins, white, None),
        )
    image = evaluate.render_view(learner, cameras, 0, 2048)
    clipped = replace(image, colour=np.clip(image.colour, 0.0, 1.0))
    return lambda: evaluate.view_scores(clipped, views.test, 0), partial(others_scores, clipped.colour)


def others_scores(image: np.ndarray) -> None:
    """Compute FLIP and CIEDE2000 of an image and its mirror image by the libraries that implement them: most of a
    score's seconds, so that the quotient hardly depends on the machine.
    """
    import colour
    import flip_evaluator

    first, second = np.ascontiguousarray(image), np.ascontiguousarray(image[:, ::-1])
    flip_evaluator.evaluate(first, second, "LDR", inputsRGB=True, applyMagma=False, computeMeanError=True)
    labs = [colour.XYZ_to_Lab(colour.RGB_to_XYZ(side.astype(np.float64), "sRGB")) for side in (first, second)]
    colour.delta_E(*labs, method="CIE 2000")
