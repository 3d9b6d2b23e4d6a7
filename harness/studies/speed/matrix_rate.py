"""Question 2: which share of the machine's own matrix rate a training step reaches."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import torch

from baselines.composition import skip_layer
from baselines.contract import NetworkSize
from baselines.field import DTYPES
from baselines.numerics.encoding import feature_count
from harness.plan.settings import GridSettings, TrainSettings
from harness.records.charts import Table
from harness.records.speed_record import Measurement
from harness.studies.speed.speed_context import (
    DENSE,
    SpeedContext,
    interleaved,
    measured,
    paper_settings,
    reduced_plan,
    synthetic_batch,
)
from harness.studies.speed.throughput import dense_side

ITEM = 2
CHUNKS = (1024, 2048, 4096, 8192, 16384)
"""Rows of the left factor: with 256 columns they fit the caches of a core, or just no longer do."""
CHUNKS_ON_A_GPU = (*CHUNKS, 65536, 262144)


@dataclass(frozen=True)
class Product:
    """One matrix product of a step: [rows, inputs] × [inputs, outputs]."""

    inputs: int
    outputs: int
    gradient: bool = True
    """Whether the inputs need one, too: what is encoded does not."""
    a_ray: bool = False
    """One row a ray instead of one a point."""


def products(size: NetworkSize, view_dependent: bool = True) -> list[Product]:
    """Concatenations are taken apart: encoded position and direction get no gradient, and the direction's part of a
    layer is the same for all points of a ray.
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
    """Multiplications and additions of the matrix products of one training step: 2 · in · out a row forward, as many
    for the weights' gradients, and as many for the inputs' where they have one.
    """
    return float(
        sum(
            2 * one.inputs * one.outputs * (3 if one.gradient else 2) * (rays if one.a_ray else points)
            for one in products(size, view_dependent)
        )
    )


def product_rates(situation: SpeedContext, width: int, dtype: torch.dtype) -> dict[int, list[float]]:
    """FLOP/s of `torch.mm` [chunk, width] × [width, width] into memory that is there, by chunk."""
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
    """The chunk that is multiplied fastest (its median decides), and its rates."""
    chunk = max(rates, key=lambda one: sorted(rates[one])[len(rates[one]) // 2])
    return chunk, rates[chunk]


def measure(situation: SpeedContext) -> Iterator[Measurement | Table]:
    """The rate of the products alone, before and after the steps: a clock that changes meanwhile shows as spread."""
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
            ITEM,
            f"The machine's own rate, {precision}",
            [rate / 1e12 for rate in rates],
            "TFLOP/s",
            detail=f"torch.mm of [{chunk}, {width}] × [{width}, {width}], {situation.threads} threads",
        )
    columns = ["product", "precision", "rows of the fastest chunk", "GFLOP/s"]
    yield Table("machine.products", ITEM, "Matrix products alone", columns, rows)


def _share(
    situation: SpeedContext, name: str, settings: TrainSettings, rows: list[list[str | float | None]]
) -> Iterator[Measurement]:
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
        ITEM,
        f"Share of the matrix rate, {shape}, {settings.precision}",
        [100.0 * flops / one / best for one in seconds],
        "%",
        target=40.0 if situation.device.type == "cuda" else 65.0,
        detail=f"{flops / 1e9:.1f} GFLOP a step of {settings.rays * settings.bins} points; the products alone reach "
        f"{best / 1e9:.0f} GFLOP/s in chunks of {chunk} rows",
    )
    yield measured(
        f"matrix.{name}.rate",
        ITEM,
        f"Rate of a whole step, {shape}, {settings.precision}",
        [flops / one / 1e12 for one in seconds],
        "TFLOP/s",
    )
