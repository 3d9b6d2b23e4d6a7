"""Question 1: ray samples a second of training steps of the paper's network, plain and accelerated."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import torch

from baselines.contract import Rays
from baselines.plain import PlainField, plain_step
from harness.machine.device import keep_freed_memory, return_freed_memory
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, TrainSettings
from harness.records.speed_record import Measurement
from harness.studies.speed.speed_context import (
    STREAM,
    SpeedContext,
    batches_of,
    interleaved,
    measured,
    new_trainer,
    paper_settings,
    quotients,
    synthetic_batch,
    trained_reduced,
    unit_box,
    use_grid_of,
    views_of,
)
from harness.training.lockstep import box_of
from harness.training.trainer import Trainer

ITEM = 1
NEVER = 10**9


def measure(situation: SpeedContext) -> Iterator[Measurement]:
    """The headline ratio evaluates exactly the same number of samples on both sides."""
    settings = paper_settings(situation)
    batch = synthetic_batch(situation, settings.rays)
    samples = settings.rays * settings.bins
    sides: dict[str, Callable[[], object]] = {
        "plain": plain_side(situation, settings, batch),
        "accelerated": dense_side(situation, settings, batch),
    }
    if settings.precision != "float32":
        sides["float32"] = dense_side(situation, replace(settings, precision="float32"), batch)
    # freed memory is kept by every training process of the harness, and by no plain one
    before = {name: return_freed_memory if name == "plain" else keep_freed_memory for name in sides}
    seconds = interleaved(sides, situation.repeats(5), situation.synchronise, before=before)
    words = f"{settings.rays} rays × {settings.bins} samples, all evaluated, {situation.threads} threads on both sides"
    yield measured(
        "training.dense.ratio",
        ITEM,
        f"Training step, {settings.precision} products, against plain float32",
        quotients(seconds["plain"], seconds["accelerated"]),
        "×",
        target=situation.target(10.0, 2.0),
        detail=words,
    )
    if "float32" in seconds:
        yield measured(
            "training.dense.float32.ratio",
            ITEM,
            "Training step, float32 products, against plain float32",
            quotients(seconds["plain"], seconds["float32"]),
            "×",
            detail=words,
        )
    for name, title in (("plain", "plain float32"), ("accelerated", settings.precision), ("float32", "float32")):
        if name in seconds:
            rates = [samples / one / 1e6 for one in seconds[name]]
            yield measured(
                f"training.dense.{name}.rate", ITEM, f"Training, {title}", rates, "million samples/s", detail=words
            )
    yield _with_skipping(situation, settings)


def plain_side(
    situation: SpeedContext, settings: TrainSettings, batch: tuple[Rays, torch.Tensor]
) -> Callable[[], object]:
    field = PlainField(settings.network, unit_box(situation.device), STREAM).to(situation.device)
    optimiser = torch.optim.Adam(field.parameters(), lr=settings.learning_rate)

    def step() -> None:
        plain_step(field, optimiser, *batch, settings.bins, generator_for(STREAM, 0, "jitter"))

    return step


def dense_side(
    situation: SpeedContext, settings: TrainSettings, batch: tuple[Rays, torch.Tensor]
) -> Callable[[], object]:
    """A step of the harness; raises `RuntimeError` where it leaves a sample out, which would not be comparable."""
    trainer = new_trainer(situation, settings, unit_box(situation.device), view_dependent=True)
    trainer.warm_up(*batch)

    def step() -> None:
        before = trainer.network_evaluations
        trainer.train_on(*batch)
        if trainer.network_evaluations - before != settings.rays * settings.bins:
            raise RuntimeError(f"a dense step evaluated {trainer.network_evaluations - before} samples")

    return step


def _with_skipping(situation: SpeedContext, settings: TrainSettings) -> Measurement:
    """Samples that a step stands for: those in empty space count, and are not evaluated."""
    views = views_of(situation, "lego")
    batches = batches_of(views, situation.device)
    found = trained_reduced(situation)
    # cut to the box and skipping, never refreshed: the paper's network has learnt nothing that it could look for
    accelerations = replace(settings.accelerations, grid=True, clipping=True)
    cells = found.settings.grid.cells
    grid = GridSettings(cells=cells, first_step=0, every=NEVER)
    sparse = replace(settings, grid=grid, accelerations=accelerations)
    trainer = new_trainer(situation, sparse, box_of(views, situation.device), view_dependent=True)
    use_grid_of(found, trainer)
    trainer.warm_up(*batches.batch(STREAM, 0, settings.rays))
    rates: list[float] = []
    before = trainer.network_evaluations
    for step in range(situation.repeats(12)):
        rates.append(_rate(trainer, *batches.batch(STREAM, step, settings.rays)))
    stood_for = len(rates) * settings.rays * settings.bins
    share = (trainer.network_evaluations - before) / stood_for
    return measured(
        "training.skipping.rate",
        ITEM,
        "Training with empty-space skipping: samples stood for, not evaluated",
        rates,
        "million samples/s",
        detail=f"lego, grid of {cells}³ cells of a trained field; {share:.0%} of the samples were evaluated",
    )


def _rate(trainer: Trainer, rays: Rays, colours: torch.Tensor) -> float:
    began = trainer.clock.seconds
    trainer.train_on(rays, colours)
    return len(rays) * trainer.settings.bins / (trainer.clock.seconds - began) / 1e6
