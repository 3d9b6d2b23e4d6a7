"""Speed gates: seconds of a training step, of a rendered view and of its scores, in seconds of a calibration kernel
that runs in turn with them in the same process. A slower machine, or a busy one, is slower at both.
"""

import os
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import torch

from harness import evaluate
from harness.batches import Batches
from harness.gate.catalog import RENEWAL_PROCESSES, SPEED_REPEATS, TRAINED_SCENES, Gate
from harness.gate.outcome import Sample
from harness.gate.situation import Renewal, Situation
from harness.gate.training import gate_plan
from harness.learner import Learner
from harness.lockstep import box_of
from harness.scratch import scratch_folder
from harness.speed.drawn_views import write_disc
from harness.speed.timing import interleaved, quotients
from harness.stopping import end_with_parent
from harness.trainer import Trainer
from scenes.view_set import ViewSet, read_view_set

STEPS_BEFORE = 80
"""The occupancy grid is in use from then on."""
KERNEL_ROWS, KERNEL_WIDTH, KERNEL_LAYERS = 8192, 64, 8
STREAM = "speed"


def measure(situation: Situation, gates: tuple[Gate, ...]) -> dict[str, Sample]:
    found = in_a_process(tuple(gate.name for gate in gates), situation.out)
    return {name: Sample([ratio]) for name, ratio in found.items()}


def renew(situation: Situation, gates: tuple[Gate, ...]) -> Renewal:
    """In several processes, one after another: what a process finds where in memory is part of the spread."""
    names = tuple(gate.name for gate in gates)
    found: Renewal = {name: [] for name in names}
    for number in range(RENEWAL_PROCESSES):
        for name, ratio in in_a_process(names, situation.out).items():
            found[name].append(ratio)
        situation.show.line(f"speed: process {number + 1} of {RENEWAL_PROCESSES}")
    return found


def in_a_process(names: tuple[str, ...], out: Path) -> dict[str, float]:
    """`ratios` in a fresh process. Raises `RuntimeError` with what it said where it fails."""
    context = get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(theirs, names, out), daemon=True)
    process.start()
    theirs.close()
    try:
        found: dict[str, float] | str = ours.recv()
    except EOFError:
        found = "it ended without an answer"
    finally:
        process.kill()  # it has said what it had to
        process.join()
    if isinstance(found, str):
        raise RuntimeError(f"the process that is timed: {found}")
    return found


def _answer(connection: Connection, names: tuple[str, ...], out: Path) -> None:
    end_with_parent()
    try:
        connection.send(ratios(names, out))
    except Exception as error:
        connection.send(f"{type(error).__name__}: {error}")
    connection.close()
    # without the interpreter's teardown, in which OpenImageIO's bindings print warnings that no user asked for
    os._exit(0)


def ratios(names: tuple[str, ...], out: Path, clock: Callable[[], float] = time.perf_counter) -> dict[str, float]:
    """Gate → median over the repetitions of seconds per seconds of the kernel."""
    from harness.device import keep_freed_memory, use_threads

    use_threads(1)
    keep_freed_memory()
    with scratch_folder(out) as scratch:
        write_disc(scratch / "views", 40, 20, 2, seed=3)
        views = read_view_set(scratch / "views", scratch=scratch)
        sides = {name: side_of(name, views) for name in names}
        return {name: ratio(side, clock) for name, side in sides.items()}


def ratio(side: Callable[[], object], clock: Callable[[], float] = time.perf_counter) -> float:
    """Median of repeated pairs: what disturbs the machine for a while disturbs both."""
    seconds = interleaved({"side": side, "kernel": kernel()}, SPEED_REPEATS, least_seconds=0.02, clock=clock)
    return statistics.median(quotients(seconds["side"], seconds["kernel"]))


def kernel() -> Callable[[], object]:
    """Products of matrices, comparisons and exponentials in float32, in about the mix of a small network."""
    generator = torch.Generator().manual_seed(0)
    x = torch.rand(KERNEL_ROWS, KERNEL_WIDTH, generator=generator)
    weights = [
        torch.randn(KERNEL_WIDTH, KERNEL_WIDTH, generator=generator) / KERNEL_WIDTH**0.5 for _ in range(KERNEL_LAYERS)
    ]

    def call() -> torch.Tensor:
        y = x
        for weight in weights:
            y = torch.relu(y @ weight)
        return torch.exp(-y).sum()

    return call


def side_of(name: str, views: ViewSet) -> Callable[[], object]:
    """What the gate of that name measures, ready to be called."""
    what, _, method = name.removeprefix("speed.").partition(".")
    learner = trained(method or "nerf", views)
    cameras = evaluate.cameras_of(views, views.test, learner.device)
    if what == "train":
        batches = Batches(evaluate.cameras_of(views, views.train, learner.device), views.train.rgba)
        rays = gate_plan((0,), TRAINED_SCENES, (method,)).train.rays

        def step() -> None:
            learner.train_on(*batches.batch(STREAM, learner.step, rays))

        return step
    if what == "render":
        return lambda: evaluate.render_view(learner, cameras, 0, 2048)
    image = evaluate.render_view(learner, cameras, 0, 2048)
    clipped = replace(image, colour=np.clip(image.colour, 0.0, 1.0))
    return lambda: evaluate.view_scores(clipped, views.test, 0)


def trained(method: str, views: ViewSet) -> Learner:
    """With the gate's settings, past the step from which the grid is in use."""
    plan = gate_plan((0,), TRAINED_SCENES, (method,))
    device = torch.device("cpu")
    learner = Trainer(method, box_of(views, device), plan.train, plan.budget, STREAM, device)
    batches = Batches(evaluate.cameras_of(views, views.train, device), views.train.rgba)
    learner.warm_up(*batches.batch(STREAM, 0, plan.train.rays))
    for step in range(STEPS_BEFORE):
        learner.train_on(*batches.batch(STREAM, step, plan.train.rays))
    return learner
