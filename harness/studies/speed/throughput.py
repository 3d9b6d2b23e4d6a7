"""Question 1: ray samples per second of training steps of the paper's network, plain and accelerated."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import torch

from baselines.composition import skip_layer
from baselines.contract import NetworkSize, Rays
from baselines.field import DTYPES
from baselines.numerics.encoding import feature_count
from baselines.plain import PlainField, plain_step
from harness.machine.device import keep_freed_memory, return_freed_memory
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, TrainSettings
from harness.records.study import Check, Table
from harness.studies.speed.speed_context import (
    DENSE,
    STREAM,
    SpeedContext,
    batches_of,
    interleaved,
    measured,
    new_trainer,
    paper_settings,
    quotients,
    reduced_plan,
    synthetic_batch,
    trained_reduced,
    unit_box,
    use_grid_of,
    views_of,
)
from harness.training.lockstep import box_of
from harness.training.trainer import Trainer

NEVER = 10**9


def measure(situation: SpeedContext) -> Iterator[Check]:
    """Yield the headline ratio, in which both sides evaluate exactly the same number of samples, and its details."""
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
        f"Training step, {settings.precision} products, against plain float32",
        quotients(seconds["plain"], seconds["accelerated"]),
        "×",
        target=situation.target(10.0, 2.0),
        detail=words,
    )
    if "float32" in seconds:
        yield measured(
            "training.dense.float32.ratio",
            "Training step, float32 products, against plain float32",
            quotients(seconds["plain"], seconds["float32"]),
            "×",
            detail=words,
        )
    for name, title in (("plain", "plain float32"), ("accelerated", settings.precision), ("float32", "float32")):
        if name in seconds:
            rates = [samples / one / 1e6 for one in seconds[name]]
            yield measured(
                f"training.dense.{name}.rate", f"Training, {title}", rates, "million samples/s", detail=words
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
    """Return a step of the harness, which raises `RuntimeError` if it leaves a sample out and so would not be
    comparable.
    """
    trainer = new_trainer(situation, settings, unit_box(situation.device), view_dependent=True)
    trainer.warm_up(*batch)

    def step() -> None:
        before = trainer.network_evaluations
        trainer.train_on(*batch)
        if trainer.network_evaluations - before != settings.rays * settings.bins:
            raise RuntimeError(f"a dense step evaluated {trainer.network_evaluations - before} samples")

    return step


def _with_skipping(situation: SpeedContext, settings: TrainSettings) -> Check:
    """Count the samples that a step stands for: those in empty space count, and are not evaluated."""
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
        "Training with empty-space skipping: samples stood for, not evaluated",
        rates,
        "million samples/s",
        detail=f"lego, grid of {cells}³ cells of a trained field; {share:.0%} of the samples were evaluated",
    )


def _rate(trainer: Trainer, rays: Rays, colours: torch.Tensor) -> float:
    began = trainer.clock.seconds
    trainer.train_on(rays, colours)
    return len(rays) * trainer.settings.bins / (trainer.clock.seconds - began) / 1e6


CHUNKS = (1024, 2048, 4096, 8192, 16384)
"""The rows of the left factor: with 256 columns they fit the caches of a core, or just no longer do."""
CHUNKS_ON_A_GPU = (*CHUNKS, 65536, 262144)


@dataclass(frozen=True)
class Product:
    """One matrix multiplication of a step: [rows, inputs] × [inputs, outputs]."""

    inputs: int
    outputs: int
    gradient: bool = True
    """Whether the inputs need a gradient, too: encoded inputs do not."""
    a_ray: bool = False
    """Whether it has one row per ray instead of one per point."""


def products(size: NetworkSize, view_dependent: bool = True) -> list[Product]:
    """Return the matrix multiplications of a step. Concatenations are split: encoded position and direction get no
    gradient, and the direction's part of a layer is the same for all points of a ray.
    """
    position = feature_count(3, size.position_bands)
    skip = skip_layer("half", size.depth)
    found = [Product(position, size.width, gradient=False)]
    for layer in range(1, size.depth):
        found.append(Product(size.width, size.width))
        if layer == skip + 1:
            found.append(Product(position, size.width, gradient=False))
    colour = [size.width] + [size.colour_width] * size.colour_layers + [3]
    found.append(Product(size.width, 1))
    found += [Product(inputs, outputs) for inputs, outputs in pairwise(colour)]
    if size.depth == skip + 1:  # the skip feeds the heads
        found += [Product(position, 1, gradient=False), Product(position, colour[1], gradient=False)]
    if view_dependent:
        found.append(Product(feature_count(3, size.direction_bands), colour[1], gradient=False, a_ray=True))
    return found


def step_flops(size: NetworkSize, points: int, rays: int, view_dependent: bool = True) -> float:
    """Count the multiplications and additions of the matrix multiplications of one training step: 2 · in · out per row
    forward, as many for the weights' gradients, and as many for the inputs' if they have one.
    """
    return float(
        sum(
            2 * one.inputs * one.outputs * (3 if one.gradient else 2) * (rays if one.a_ray else points)
            for one in products(size, view_dependent)
        )
    )


def product_rates(situation: SpeedContext, width: int, dtype: torch.dtype) -> dict[int, list[float]]:
    """Return the FLOP/s of `torch.mm` [chunk, width] × [width, width] into allocated memory, by chunk."""
    generator = torch.Generator().manual_seed(0)
    weight = torch.randn(width, width, generator=generator).to(situation.device, dtype)
    sides: dict[str, Callable[[], object]] = {}
    usual = CHUNKS_ON_A_GPU if situation.device.type == "cuda" else CHUNKS
    chunks = CHUNKS[:2] if situation.quick else usual
    for chunk in chunks:
        left = torch.randn(chunk, width, generator=generator).to(situation.device, dtype)
        out = torch.empty(chunk, width, dtype=dtype, device=situation.device)
        sides[str(chunk)] = partial(torch.mm, left, weight, out=out)
    least = 0.01 if situation.quick else 0.15
    seconds = interleaved(sides, situation.repeats(5), situation.synchronise, least)
    return {chunk: [2.0 * chunk * width * width / one for one in seconds[str(chunk)]] for chunk in chunks}


def best_rate(rates: dict[int, list[float]]) -> tuple[int, list[float]]:
    """Return the chunk that is multiplied fastest (its median decides), and its rates."""
    chunk = max(rates, key=lambda one: sorted(rates[one])[len(rates[one]) // 2])
    return chunk, rates[chunk]


def share_of_matrix_rate(situation: SpeedContext) -> Iterator[Check | Table]:
    """Yield the rate of matrix multiplications alone, before and after the steps: a clock that changes meanwhile shows
    as spread.
    """
    rows: list[list[str | float | None]] = []
    reduced = reduced_plan(situation).train
    reduced = replace(
        reduced,
        rays=reduced.rays * (1 if situation.quick else 2),
        first_bins=reduced.bins,
        grid=GridSettings(cells=0),
        accelerations=DENSE,
    )
    for name, settings in (("paper", paper_settings(situation)), ("reduced", reduced)):
        yield from _share(situation, name, settings, rows)
    width = 32 if situation.quick else 1024
    for precision, dtype in DTYPES.items():
        chunk, rates = best_rate(product_rates(situation, width, dtype))
        rows.append([f"{width} × {width}", precision, float(chunk), sorted(rates)[len(rates) // 2] / 1e9])
        yield measured(
            f"machine.{precision}.rate",
            f"The machine's own rate, {precision}",
            [rate / 1e12 for rate in rates],
            "TFLOP/s",
            detail=f"torch.mm of [{chunk}, {width}] × [{width}, {width}], {situation.threads} threads",
        )
    columns = ["product", "precision", "rows of the fastest chunk", "GFLOP/s"]
    yield Table("machine.products", 0, "Matrix products alone", columns, rows)


def _share(
    situation: SpeedContext, name: str, settings: TrainSettings, rows: list[list[str | float | None]]
) -> Iterator[Check]:
    size, dtype = settings.network, DTYPES[settings.precision]
    batch = synthetic_batch(situation, settings.rays)
    step = dense_side(situation, settings, batch)
    for _ in range(situation.repeats(3)):
        step()
    before = product_rates(situation, size.width, dtype)
    seconds = interleaved({"step": step}, situation.repeats(7), situation.synchronise, 0.1)["step"]
    after = product_rates(situation, size.width, dtype)
    chunk, rates = best_rate({key: before[key] + after[key] for key in before})
    flops = step_flops(size, settings.rays * settings.bins, settings.rays)
    best = sorted(rates)[len(rates) // 2]
    shape = f"{size.depth} × {size.width}, colour {size.colour_layers} × {size.colour_width}"
    rows.append([f"{size.width} × {size.width}", settings.precision, float(chunk), best / 1e9])
    yield measured(
        f"matrix.{name}.share",
        f"Share of the matrix rate, {shape}, {settings.precision}",
        [100.0 * flops / one / best for one in seconds],
        "%",
        target=40.0 if situation.device.type == "cuda" else 65.0,
        detail=f"{flops / 1e9:.1f} GFLOP a step of {settings.rays * settings.bins} points; the products alone reach "
        f"{best / 1e9:.0f} GFLOP/s in chunks of {chunk} rows",
    )
    yield measured(
        f"matrix.{name}.rate",
        f"Rate of a whole step, {shape}, {settings.precision}",
        [flops / one / 1e12 for one in seconds],
        "TFLOP/s",
    )
