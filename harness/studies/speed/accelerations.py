"""Question 11: what each acceleration gains at the reduced profile."""

from collections.abc import Iterator
from dataclasses import fields

from baselines.contract import NO_ACCELERATION, Accelerations
from harness.machine.stopwatch import Stopwatch
from harness.records.study import Check
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
from harness.training.learner import at_step, train
from harness.training.scoring.evaluate import cameras_of, render_view


def measure(context: SpeedContext) -> Iterator[Check]:
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
