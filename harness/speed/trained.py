"""Trainers in a state worth measuring: their occupancy grid in use, their weights equal where settings differ."""

from dataclasses import replace

import torch

from baselines.accelerations import Accelerations
from baselines.contract import Box
from harness.lockstep import box_of, needs_view_direction
from harness.schedule import Budget
from harness.settings import TrainSettings
from harness.speed.situation import Situation, batches_of, reduced_plan, views_of
from harness.trainer import Trainer

STREAM = "speed/0"
"""Seeds every batch and every first weight: all that is compared sees the same."""


def new_trainer(
    situation: Situation,
    settings: TrainSettings,
    box: Box,
    view_dependent: bool,
    budget: Budget | None = None,
) -> Trainer:
    """Vanilla NeRF. Without the acceleration `directions` every scene has a direction branch; without a budget the
    learning rate stays as it is.
    """
    directed = view_dependent or not settings.accelerations.directions
    return Trainer("nerf", box, settings, budget or Budget(None, None), STREAM, situation.device, directed)


def trained_reduced(situation: Situation, view_dependent: bool | None = None, steps: int | None = None) -> Trainer:
    """The reduced profile's NeRF on lego, far enough that empty space is skipped."""
    plan = reduced_plan(situation)
    views = views_of(situation, "lego")
    directed = needs_view_direction(views) if view_dependent is None else view_dependent
    trainer = new_trainer(situation, plan.train, box_of(views, situation.device), directed, plan.budget)
    batches = batches_of(views, situation.device)
    trainer.warm_up(*batches.batch(STREAM, 0, plan.train.rays))
    if steps is None:
        steps = plan.train.grid.first_step + (10 if situation.quick else 300)
    for step in range(steps):
        trainer.train_on(*batches.batch(STREAM, step, plan.train.rays))
    return trainer


def variant_of(source: Trainer, situation: Situation, accelerations: Accelerations) -> Trainer:
    """A copy in the same state with other accelerations; what its colour has of directions starts at zero, so that it
    shows the same.
    """
    settings = replace(source.settings, accelerations=accelerations)
    copy = new_trainer(situation, settings, source.box, source.coarse.view_dependent, source.budget)
    copy_weights(source.fields, copy.fields)
    copy.step = source.step
    if copy.grid is not None and source.grid is not None:
        copy.grid.density = source.grid.density.clone()
        copy.grid.occupied = source.grid.occupied.clone()
    return copy


@torch.no_grad()
def copy_weights(source: torch.nn.Module, target: torch.nn.Module) -> None:
    """Equal functions, also where `target` has further inputs behind those of `source`."""
    theirs = dict(source.named_parameters())
    for name, weight in target.named_parameters():
        value = theirs[name]
        if weight.ndim == 2:
            weight.zero_()
            weight[:, : value.shape[1]] = value
        else:
            weight.copy_(value)


def use_grid_of(source: Trainer, target: Trainer) -> None:
    """Empty space as `source` has found it, from now on and for good: `target` is not to look for itself."""
    if source.grid is None or target.grid is None:
        raise ValueError("both need an occupancy grid")
    target.grid.density = source.grid.density.clone()
    target.grid.occupied = source.grid.occupied.clone()
    target.step = max(target.step, target.settings.grid.first_step + 1)
