"""Settings so small that a cell trains in a second, and rays to train on without a scene."""

from dataclasses import replace
from typing import TypeVar

import torch

from baselines.catalog import CATALOG
from baselines.contract import Box, NetworkSize, Rays
from baselines.methods.chosen import DensityConstants, chosen
from harness.plan.schedule import Budget
from harness.plan.settings import GridSettings, ScoreSettings, TrainSettings, ViewSettings
from harness.training.learner import Job, Learner
from harness.training.trainer import Trainer

L = TypeVar("L", bound=Learner)

OWN = {
    method: replace(CATALOG[method].settings, density_scale=25.0, start=None if pair.start is None else 0.3)
    for method, pair in {**chosen("reduced"), "qnerf_repaired": DensityConstants(25.0, 0.3)}.items()
} | {"nerf_matched": replace(CATALOG["nerf_matched"].settings, density_scale=25.0, start=0.3)}
"""Settings with fixed unit and start of density, which no search changes."""
TRAIN = TrainSettings(
    network=NetworkSize(depth=6, width=16, colour_layers=2, colour_width=16, position_bands=4, direction_bands=2),
    rays=64, bins=16, first_bins=12, fine_bins=0, learning_rate=1e-2, last_learning_rate=1e-3, warm_up_steps=5,
    average=4.0, grid=GridSettings(cells=8, first_step=10, every=5), own=OWN,
)  # fmt: skip
SCORE = ScoreSettings(checkpoints=3, earliest=0.25, chunk=512, train_views=2, stored_views=1)
VIEWS = ViewSettings(resolution=24, train=10, val=0, test=3)
BUDGET = Budget(steps=24, seconds=None)
CPU = torch.device("cpu")


def box() -> Box:
    return Box(-torch.ones(3), torch.ones(3))


def rays_and_colours(count: int = 64, seed: int = 0) -> tuple[Rays, torch.Tensor]:
    """Return rays from all sides that cross the box, and a colour for each."""
    generator = torch.Generator().manual_seed(seed)
    origins = 4.0 * torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)
    aims = 0.3 * torch.rand(count, 3, generator=generator)
    directions = torch.nn.functional.normalize(aims - origins, dim=-1)
    return Rays(origins, directions, 2.0, 6.0), torch.rand(count, 3, generator=generator)


def trainer(method: str = "nerf", settings: TrainSettings = TRAIN, budget: Budget = BUDGET, seed: int = 0) -> Trainer:
    return Trainer(Job(method, box(), settings, budget, seed, CPU))


def train(learner: L, steps: int) -> L:
    """Train the learner for `steps` steps, each on another batch."""
    for step in range(steps):
        learner.train_on(*rays_and_colours(seed=step))
    return learner


def weights(learner: Learner) -> dict[str, torch.Tensor]:
    return {name: value.clone() for name, value in learner.fields.state_dict().items()}


def same(first: dict[str, torch.Tensor], second: dict[str, torch.Tensor]) -> bool:
    return set(first) == set(second) and all(torch.equal(first[name], second[name]) for name in first)
