"""O5: trainings and their twins in float64, with the same weights, batches and random draws."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import torch

from harness.records.study import Table, check
from harness.studies.framework import Found, Rows
from harness.studies.stability.fields import small_training
from harness.studies.stability.stability_context import StabilityContext, owner_of_method
from harness.training.batches import Batch
from harness.training.trainer import Trainer

STEPS = (1, 10, 40, 100, 300)
"""The steps after which losses are compared."""


def float64_twin(context: StabilityContext) -> Iterator[Found]:
    methods, others = small_training.with_parts(context)
    here = small_training.setup(context)
    rows: Rows = []
    first: list[float] = []
    for method in methods:
        double = in_dtype(small_training.new_trainer(context, method), torch.float64)
        twin = small_training.train(context, double, batch_at=doubled(context))
        single = small_training.trained(context, method)
        apart = [abs(loss / exact - 1.0) for loss, exact in zip(single.losses, twin.losses, strict=True)]
        rows.append([method, *(apart[step - 1] if step <= len(apart) else None for step in STEPS)])
        first.append(apart[0])
        both = single.trainer, in_dtype(double, torch.float32)
        psnr, psnr_of_twin = (small_training.psnr_of(trainer, here.views) for trainer in both)
        what = f"test PSNR apart after {here.steps} steps, dB"
        yield check(what, abs(psnr - psnr_of_twin), high=0.5, subject=method, owner=owner_of_method(method))
    yield from others
    if methods:
        what = "largest relative difference of the first loss, float32 against float64"
        yield check(what, max(first), high=1e-6, subject="the same weights, batch and draws")
    columns = ["method", *(f"after {step} steps" for step in STEPS)]
    title = "Loss of a step's batch, relative difference from a training in float64"
    yield Table("float64 twin", 5, title, columns, rows)


def in_dtype(trainer: Trainer, dtype: torch.dtype) -> Trainer:
    """Convert weights, box and grid of the trainer, but not its optimiser, to a dtype; return the trainer."""
    box = replace(trainer.box, lower=trainer.box.lower.to(dtype), upper=trainer.box.upper.to(dtype))
    trainer.fields.to(dtype)
    trainer.box, trainer.background = box, trainer.background.to(dtype)
    field: Any
    for field in trainer.fields.values():
        field.box, field.dtype = box, dtype
    if trainer.grid is not None:
        trainer.grid.box, trainer.grid.density = box, trainer.grid.density.to(dtype)
    return trainer


def doubled(context: StabilityContext) -> Callable[[int], Batch]:
    here = small_training.setup(context)
    batch_at = here.batches.stream(small_training.STREAM, here.settings.rays)

    def doubled_at(step: int) -> Batch:
        batch = batch_at(step)
        return batch._replace(rays=batch.rays.to(torch.float64), colours=batch.colours.double())

    return doubled_at
