"""O5: trainings and their twins in float64, with the same weights, batches and random draws."""

from collections.abc import Callable, Iterator
from typing import Any

import torch

from baselines.contract import Box
from harness.records.study import Table, check
from harness.studies.framework import Found, Rows
from harness.studies.stability.fields.small_training import (
    STREAM,
    History,
    new_trainer,
    psnr_of,
    setup,
    train,
    trained,
    with_parts,
)
from harness.studies.stability.stability_context import StabilityContext, owner_of_method
from harness.training.batches import Batch
from harness.training.trainer import Trainer

STEPS = (1, 10, 40, 100, 300)
"""The steps after which losses are compared."""


def float64_twin(context: StabilityContext) -> Iterator[Found]:
    methods, others = with_parts(context)
    here = setup(context)
    rows: Rows = []
    first: list[float] = []
    for method in methods:
        twin = train(context, in_dtype(new_trainer(context, method), torch.float64), batch_at=doubled(context))
        single = trained(context, method)
        rows.append([method, *_differences(single, twin)])
        first.append(_difference(single, twin, 1))
        change = abs(psnr_of(single.trainer, here.views) - psnr_of(in_dtype(twin.trainer, torch.float32), here.views))
        what = f"test PSNR apart after {here.steps} steps, dB"
        yield check(what, change, high=0.5, subject=method, owner=owner_of_method(method))
    yield from others
    if methods:
        what = "largest relative difference of the first loss, float32 against float64"
        yield check(what, max(first), high=1e-6, subject="the same weights, batch and draws")
    heads = ["method", *(f"after {step} steps" for step in STEPS)]
    yield Table(
        "float64 twin", 5, "Loss of a step's batch, relative difference from a training in float64", heads, rows
    )


def in_dtype(trainer: Trainer, dtype: torch.dtype) -> Trainer:
    """Convert weights, box and grid of the trainer, but not its optimiser, to a dtype; return the trainer."""
    box = Box(trainer.box.lower.to(dtype), trainer.box.upper.to(dtype), trainer.box.hull)
    trainer.fields.to(dtype)
    trainer.box, trainer.background = box, trainer.background.to(dtype)
    field: Any
    for field in trainer.fields.values():
        field.box, field.dtype = box, dtype
    if trainer.grid is not None:
        trainer.grid.box, trainer.grid.density = box, trainer.grid.density.to(dtype)
    return trainer


def doubled(context: StabilityContext) -> Callable[[int], Batch]:
    here = setup(context)
    batch_at = here.batches.stream(STREAM, here.settings.rays)

    def doubled_at(step: int) -> Batch:
        batch = batch_at(step)
        return batch._replace(rays=batch.rays.to(torch.float64), colours=batch.colours.double())

    return doubled_at


def _differences(history: History, twin: History) -> list[float | None]:
    return [_difference(history, twin, step) if step <= len(history.losses) else None for step in STEPS]


def _difference(history: History, twin: History, step: int) -> float:
    return abs(history.losses[step - 1] / twin.losses[step - 1] - 1.0)
