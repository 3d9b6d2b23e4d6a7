"""What a plan will cost on this machine, from a few measured steps; printed before anything is done."""

import time

import torch

from baselines.contract import Box, Rays
from harness.plan import Plan
from harness.seeds import generator_for
from harness.trainer import Trainer

SECONDS_PER_MEGASAMPLE = 0.8
"""Mitsuba's path tracer at its slower (`scalar_rgb` on two cores), over the eight scenes."""
GRID_COST = 0.7
"""A step, or a rendered ray, once empty space is skipped, relative to what is measured here before."""


def step_seconds(plan: Plan, device: torch.device, threads: int) -> tuple[float, float]:
    """Measured seconds of a training step and of rendering one ray, of vanilla NeRF on random rays in a unit box.

    Before the occupancy grid is in use.
    """
    torch.set_num_threads(threads)
    generator = generator_for("cost")
    box = Box(-torch.ones(3, device=device), torch.ones(3, device=device))
    origins = 4.0 * torch.nn.functional.normalize(torch.randn(plan.train.rays, 3, generator=generator), dim=-1)
    aims = torch.randn(plan.train.rays, 3, generator=generator) * 0.5
    directions = torch.nn.functional.normalize(aims - origins, dim=-1)
    rays = Rays(origins.to(device), directions.to(device), 2.0, 6.0)
    colours = torch.rand(plan.train.rays, 3, generator=generator).to(device)
    trainer = Trainer("nerf", box, plan.train, plan.budget, 0, device)
    trainer.warm_up(rays, colours)
    steps = 0
    while steps < 2 or (trainer.clock.seconds < 1.0 and steps < 20):
        trainer.train_on(rays, colours)
        steps += 1
    began = time.perf_counter()
    trainer.render(rays, plan.score.chunk)
    return trainer.clock.seconds / steps, (time.perf_counter() - began) / plan.train.rays


def estimate_lines(plan: Plan, device: torch.device, workers: int, threads: int) -> list[str]:
    """Estimated wall time in words, by phase."""
    step, ray = step_seconds(plan, device, threads)
    views = plan.views
    cells = len(plan.cells())
    cheaper = GRID_COST if plan.train.grid.cells else 1.0
    first = plan.train.grid.first_step if plan.train.grid.cells else 0
    by_steps = (first + cheaper * max(plan.budget.steps - first, 0)) * step if plan.budget.steps else float("inf")
    training = cells / workers * min(by_steps, plan.budget.seconds or float("inf"))
    scoring = cells / workers * plan.score.checkpoints * views.test * views.resolution**2 * ray * cheaper
    samples = (views.train + views.val) * views.spp_train + views.test * views.spp_test
    megasamples = len(plan.scenes) * samples * views.resolution**2 / 1e6
    rendering = 0.0 if plan.view_set else megasamples * SECONDS_PER_MEGASAMPLE
    total = training + scoring + rendering
    return [
        f"estimated cost: {_duration(total)} ({step * 1e3:.1f} ms a step before empty space is skipped)",
        f"  rendering at most {_duration(rendering)} unless cached, training {_duration(training)}, "
        f"scoring {_duration(scoring)}",
    ]


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
