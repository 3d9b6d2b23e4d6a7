"""Question 11: what each acceleration gains at the reduced profile, and where the remaining time goes."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields

from baselines.contract import NO_ACCELERATION, Accelerations
from harness.machine.stopwatch import Stopwatch
from harness.records.study import Check, Table
from harness.studies.framework import Rows
from harness.studies.speed.speed_context import (
    STREAM,
    Seconds,
    SpeedContext,
    batches_of,
    figure,
    ratio,
    reduced_plan,
    trained_reduced,
    variant_of,
    views_of,
)
from harness.training.batches import Batch
from harness.training.learner import at_step, train
from harness.training.scoring.evaluate import cameras_of, render_view
from harness.training.trainer import Trainer

OPERATORS = 15


def measure(context: SpeedContext) -> Iterator[Check | Table]:
    """Compare all accelerations, all but each, and none, from equal weights and batches, in blocks of a grid update."""
    views, plan = views_of(context), reduced_plan(context)
    batch_at = batches_of(views, context.device).stream(STREAM, plan.train.rays)
    cameras = cameras_of(views, views.test, context.device)
    base = trained_reduced(context)
    names = [acceleration.name for acceleration in fields(Accelerations)]
    variants = {"all": Accelerations(), **{name: Accelerations().without((name,)) for name in names}}
    trainers = {name: variant_of(base, context, on) for name, on in {**variants, "none": NO_ACCELERATION}.items()}
    block = plan.train.grid.every
    steps: Seconds = {name: [] for name in trainers}
    shows: Seconds = {name: [] for name in trainers}
    for repetition in range(-1, context.repeats(5)):
        for name, trainer in trainers.items():
            began = trainer.clock.seconds
            train(trainer, batch_at, at_step(trainer.step + block))
            watch = Stopwatch(context.device)
            with watch.running():
                render_view(trainer, cameras, len(cameras) // 2, plan.score.chunk)
            if repetition >= 0:  # the first round warms up
                steps[name].append((trainer.clock.seconds - began) / block)
                shows[name].append(watch.seconds)
    detail = f"nerf on lego without directions, from step {base.step} on, {context.threads} threads"
    for what, taken, words in (("step", steps, "A training step"), ("view", shows, "A rendered view")):
        for name in [*names, "none"]:
            without = "without any acceleration" if name == "none" else f"without `{name}`"
            title = f"{words} {without} against with all"
            yield ratio(f"accelerations.{name}.{what}", title, taken[name], taken["all"], detail)
        milliseconds = [1e3 * seconds for seconds in taken["all"]]
        yield figure(f"accelerations.all.{what}", f"{words} with all", milliseconds, "ms", detail)
    yield _remaining_time(context, trainers["all"], batch_at)


def _remaining_time(context: SpeedContext, trainer: Trainer, batch_at: Callable[[int], Batch]) -> Table:
    from torch.profiler import ProfilerActivity, profile

    steps, on_cuda = 5 if context.quick else 50, context.device.type == "cuda"
    activities = [ProfilerActivity.CPU] + [ProfilerActivity.CUDA] * on_cuda
    with _profiler_silenced(), profile(activities=activities, acc_events=True) as watched:
        train(trainer, batch_at, at_step(trainer.step + steps))
    own = "self_device_time_total" if on_cuda else "self_cpu_time_total"
    taken = [(float(getattr(event, own)), event.key, event.count) for event in watched.key_averages()]
    total = sum(microseconds for microseconds, _, _ in taken)
    largest = sorted(taken, key=lambda row: -row[0])[:OPERATORS]
    rows: Rows = [
        [name, 100.0 * microseconds / total, microseconds / steps / 1e3, count / steps]
        for microseconds, name, count in largest
    ]
    rest = total - sum(microseconds for microseconds, _, _ in largest)
    rows.append(["everything else", 100.0 * rest / total, rest / steps / 1e3, None])
    columns = ["operator", "share (%)", "ms per step", "calls per step"]
    return Table("accelerations.profile", 0, "Where the time of a reduced training step goes", columns, rows)


@contextmanager
def _profiler_silenced() -> Iterator[None]:
    """Silence the profiler's library, which writes errors to the terminal, some about GPUs that are not used."""
    terminal = os.dup(2)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 2)
    try:
        yield
    finally:
        os.dup2(terminal, 2)
        os.close(silent)
        os.close(terminal)
