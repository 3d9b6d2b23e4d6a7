"""Question 11: what each acceleration gains at the reduced profile, and where the time that remains goes."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields

import torch

from baselines.contract import NO_ACCELERATION, Accelerations
from harness.machine.stopwatch import Stopwatch
from harness.records.study import Check, Table
from harness.studies.speed.speed_context import (
    STREAM,
    Seconds,
    SpeedContext,
    batches_of,
    measured,
    quotients,
    reduced_plan,
    trained_reduced,
    variant_of,
    views_of,
)
from harness.training.batches import Batches, Cameras
from harness.training.evaluate import cameras_of, render_view
from harness.training.trainer import Trainer

OPERATORS = 15


def variants() -> dict[str, Accelerations]:
    """Return the accelerations: all, each one left out, and none."""
    names = [one.name for one in fields(Accelerations)]
    return {
        "all": Accelerations(),
        **{name: Accelerations().without((name,)) for name in names},
        "none": NO_ACCELERATION,
    }


def measure(situation: SpeedContext) -> Iterator[Check | Table]:
    """Yield every variant, resumed from the same weights with the same batches, in blocks that hold one update of the
    grid.
    """
    views, plan = views_of(situation, "lego"), reduced_plan(situation)
    batches, cameras = batches_of(views, situation.device), cameras_of(views, views.test, situation.device)
    base = trained_reduced(situation, view_dependent=False)
    trainers = {name: variant_of(base, situation, chosen) for name, chosen in variants().items()}
    block = plan.train.grid.every
    steps: Seconds = {name: [] for name in trainers}
    shows: Seconds = {name: [] for name in trainers}
    for repetition in range(-1, situation.repeats(5)):
        for name, trainer in trainers.items():
            seconds = block_seconds(trainer, batches, block) / block
            view = view_seconds(situation, trainer, cameras, plan.score.chunk)
            if repetition >= 0:  # the first round warms up
                steps[name].append(seconds)
                shows[name].append(view)
    detail = f"nerf on lego without directions, from step {base.step} on, {situation.threads} threads"
    for what, taken, words in (("step", steps, "A training step"), ("view", shows, "A rendered view")):
        for name in trainers:
            if name == "all":
                continue
            without = "without any acceleration" if name == "none" else f"without `{name}`"
            yield measured(
                f"accelerations.{name}.{what}.ratio",
                f"{words} {without} against with all",
                quotients(taken[name], taken["all"]),
                "×",
                detail=detail,
            )
        milliseconds = [1e3 * one for one in taken["all"]]
        yield measured(f"accelerations.all.{what}", f"{words} with all", milliseconds, "ms", detail=detail)
    yield remaining_time(situation, trainers["all"], batches)


def block_seconds(trainer: Trainer, batches: Batches, steps: int) -> float:
    began = trainer.clock.seconds
    for _ in range(steps):
        trainer.train_on(*batches.batch(STREAM, trainer.step, trainer.settings.rays))
    return trainer.clock.seconds - began


def view_seconds(situation: SpeedContext, trainer: Trainer, cameras: Cameras, chunk: int) -> float:
    watch = Stopwatch(situation.device)
    with watch.running():
        render_view(trainer, cameras, len(cameras) // 2, chunk)
    return watch.seconds


def remaining_time(situation: SpeedContext, trainer: Trainer, batches: Batches) -> Table:
    """Return the operators of training steps by their own time."""
    from torch.profiler import ProfilerActivity, profile

    steps = 5 if situation.quick else 50
    activities = [ProfilerActivity.CPU] + [ProfilerActivity.CUDA] * (situation.device.type == "cuda")
    with _profiler_unheard(), profile(activities=activities, acc_events=True) as watched:
        block_seconds(trainer, batches, steps)
    rows = [(event.key, own_microseconds(event, situation.device), event.count) for event in watched.key_averages()]
    total = sum(taken for _, taken, _ in rows)
    largest = sorted(rows, key=lambda row: -row[1])[:OPERATORS]
    shown: list[list[str | float | None]] = [
        [name, 100.0 * taken / total, taken / steps / 1e3, count / steps] for name, taken, count in largest
    ]
    rest = total - sum(taken for _, taken, _ in largest)
    shown.append(["everything else", 100.0 * rest / total, rest / steps / 1e3, None])
    columns = ["operator", "share (%)", "ms a step", "calls a step"]
    return Table("accelerations.profile", 0, "Where the time of a reduced training step goes", columns, shown)


@contextmanager
def _profiler_unheard() -> Iterator[None]:
    """Silence the profiler's library, which writes errors to the terminal by itself, some about GPUs that nobody asked
    for.
    """
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(nowhere)
        os.close(kept)


def own_microseconds(event: object, device: torch.device) -> float:
    """Return the time of an operator without those that it calls."""
    name = "self_device_time_total" if device.type == "cuda" else "self_cpu_time_total"
    return float(getattr(event, name))
