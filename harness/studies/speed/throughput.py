"""Questions 1 and 2: ray samples per second of the paper's network, and its share of the machine's matrix rate."""

import statistics
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import pairwise

import torch

from baselines.composition import skip_layer
from baselines.contract import DTYPES, NetworkSize
from baselines.numerics.encoding import feature_count
from baselines.plain import PlainField, plain_step
from harness.machine.device import keep_freed_memory, return_freed_memory
from harness.plan.seeds import generator_for
from harness.plan.settings import GridSettings, TrainSettings
from harness.records.study import Check
from harness.studies.speed.speed_context import (
    DENSE,
    STREAM,
    SpeedContext,
    figure,
    interleaved,
    new_trainer,
    paper_settings,
    random_batch,
    ratio,
    reduced_plan,
    unit_box,
)
from harness.training.batches import Batch
from harness.training.learner import take_step, warm_up


def measure(context: SpeedContext) -> Iterator[Check]:
    """Yield the headline ratio, whose two sides evaluate exactly the same number of samples, and its details."""
    settings = paper_settings(context)
    batch = random_batch(context.device, settings.rays, "speed", "rays")
    field = PlainField(settings.network, unit_box(context.device), STREAM).to(context.device)
    optimiser = torch.optim.Adam(field.parameters(), lr=settings.learning_rate)
    sides: dict[str, Callable[[], object]] = {
        "plain": lambda: plain_step(
            field, optimiser, batch.rays, batch.colours, settings.bins, generator_for(STREAM, 0, "jitter")
        ),
        "accelerated": dense_side(context, settings, batch),
    }
    if settings.precision != "float32":
        sides["float32"] = dense_side(context, replace(settings, precision="float32"), batch)
    # every training process of the harness keeps freed memory, a plain one does not
    before = {name: return_freed_memory if name == "plain" else keep_freed_memory for name in sides}
    seconds = interleaved(sides, context.repeats(5), context.synchronise, before=before)
    words = f"{settings.rays} rays × {settings.bins} samples, all evaluated, {context.threads} threads on both sides"
    title = f"Training step, {settings.precision} matrix multiplications, against plain float32"
    yield ratio("training.dense", title, seconds["plain"], seconds["accelerated"], words, context.target(10.0, 2.0))
    if "float32" in sides:
        title = "Training step, float32 matrix multiplications, against plain float32"
        yield ratio("training.dense.float32", title, seconds["plain"], seconds["float32"], words)
    for name, title in (("plain", "plain float32"), ("accelerated", settings.precision), ("float32", "float32")):
        if name in sides:
            rates = [settings.rays * settings.bins / taken / 1e6 for taken in seconds[name]]
            yield figure(f"training.dense.{name}.rate", f"Training, {title}", rates, "million samples/s", words)


def dense_side(context: SpeedContext, settings: TrainSettings, batch: Batch) -> Callable[[], object]:
    """Return a step of the harness, which raises `RuntimeError` if it does not evaluate every sample."""
    trainer = new_trainer(context, settings, unit_box(context.device))
    warm_up(trainer, lambda _: batch)

    def step() -> None:
        before = trainer.network_evaluations
        take_step(trainer, lambda _: batch)
        if trainer.network_evaluations - before != settings.rays * settings.bins:
            raise RuntimeError(f"a dense step evaluated {trainer.network_evaluations - before} samples")

    return step


CHUNKS = (1024, 2048, 4096, 8192, 16384)
"""The rows of the left factor: with 256 columns the smaller ones fit the caches of a core, the larger ones do not."""
CHUNKS_ON_A_GPU = (*CHUNKS, 65536, 262144)
EMULATED_SECONDS = 0.5
"""If the smallest multiplication takes longer, the machine emulates this type, and larger ones would take minutes."""


def step_flops(size: NetworkSize, points: int, rays: int, view_dependent: bool = True) -> float:
    """Count the operations of the matrix multiplications of one training step: 2 · in · out per row forward, the same
    again for the gradients of the weights, and again for those of the inputs if they have any.

    Concatenations are split: encoded position and direction get no gradient, and the direction's part of a layer is the
    same for all points of a ray.
    """
    colour = [size.width] + [size.colour_width] * size.colour_layers + [3]
    hidden = (size.depth - 1) * size.width**2 + size.width + sum(a * b for a, b in pairwise(colour))
    # the encoded position enters the first layer, and again the layer after the skip, or both heads
    again = 1 + colour[1] if skip_layer("half", size.depth) == size.depth - 1 else size.width
    position = feature_count(3, size.position_bands) * (size.width + again)
    direction = feature_count(3, size.direction_bands) * colour[1] if view_dependent else 0
    return 2.0 * (points * (3 * hidden + 2 * position) + rays * 2 * direction)


def _matmul_rates(context: SpeedContext, width: int, dtype: torch.dtype) -> dict[int, list[float]]:
    """Return the FLOP/s of `torch.mm` [chunk, width] × [width, width] into allocated memory, by chunk."""
    generator = torch.Generator().manual_seed(0)
    weight = torch.randn(width, width, generator=generator).to(context.device, dtype)
    usual = CHUNKS_ON_A_GPU if context.device.type == "cuda" else CHUNKS
    sides: dict[str, Callable[[], object]] = {}
    for chunk in CHUNKS[:2] if context.quick else usual:
        left = torch.randn(chunk, width, generator=generator).to(context.device, dtype)
        out = torch.empty(chunk, width, dtype=dtype, device=context.device)
        sides[str(chunk)] = partial(torch.mm, left, weight, out=out)
        if len(sides) == 1 and interleaved(sides, 1, context.synchronise)[str(chunk)][0] > EMULATED_SECONDS:
            break
    seconds = interleaved(sides, context.repeats(5), context.synchronise, 0.01 if context.quick else 0.15)
    return {int(chunk): [2.0 * int(chunk) * width * width / side for side in taken] for chunk, taken in seconds.items()}


def _best_rate(rates: dict[int, list[float]]) -> tuple[int, list[float], float]:
    chunk = max(rates, key=lambda chunk: statistics.median_high(rates[chunk]))
    return chunk, rates[chunk], statistics.median_high(rates[chunk])


def share_of_matrix_rate(context: SpeedContext) -> Iterator[Check]:
    """Compare steps with matrix multiplications timed before and after them: a changing clock shows as spread."""
    reduced = reduced_plan(context).train
    reduced = replace(
        reduced,
        rays=reduced.rays * (1 if context.quick else 2),
        first_bins=reduced.bins,
        grid=GridSettings(cells=0),
        accelerations=DENSE,
    )
    for name, settings in (("paper", paper_settings(context)), ("reduced", reduced)):
        yield from _share(context, name, settings)
    width = 32 if context.quick else 1024
    for precision, dtype in DTYPES.items():
        chunk, rates, _ = _best_rate(_matmul_rates(context, width, dtype))
        yield figure(
            f"machine.{precision}.rate",
            f"The machine's own rate, {precision}",
            [rate / 1e12 for rate in rates],
            "TFLOP/s",
            f"torch.mm of [{chunk}, {width}] × [{width}, {width}], {context.threads} threads",
        )


def _share(context: SpeedContext, name: str, settings: TrainSettings) -> Iterator[Check]:
    size, dtype, points = settings.network, DTYPES[settings.precision], settings.rays * settings.bins
    step = dense_side(context, settings, random_batch(context.device, settings.rays, "speed", "rays"))
    for _ in range(context.repeats(3)):
        step()
    before = _matmul_rates(context, size.width, dtype)
    seconds = interleaved({"step": step}, context.repeats(7), context.synchronise, 0.1)["step"]
    after = _matmul_rates(context, size.width, dtype)
    chunk, _, best = _best_rate({key: before[key] + after[key] for key in before})
    flops = step_flops(size, points, settings.rays)
    shape = f"{size.depth} × {size.width}, colour {size.colour_layers} × {size.colour_width}, {settings.precision}"
    yield figure(
        f"matrix.{name}.share",
        f"Share of the matrix rate, {shape}",
        [100.0 * flops / taken / best for taken in seconds],
        "%",
        f"{flops / 1e9:.1f} GFLOP per step of {points} points; the matrix multiplications by themselves reach "
        f"{best / 1e9:.0f} GFLOP/s in chunks of {chunk} rows",
        low=40.0 if context.device.type == "cuda" else 65.0,
    )
    rates = [flops / taken / 1e12 for taken in seconds]
    yield figure(f"matrix.{name}.rate", f"Rate of a complete step, {shape}", rates, "TFLOP/s")
