"""A mean that belongs to the field, in a real training: moved by its steps and by nothing else."""

import math
from dataclasses import replace

import pytest
import torch

from baselines.amplifiers import HeldMeanAmplifier
from baselines.methods.repaired import CANDIDATES
from harness.training.trainer import Diverged, Trainer
from tests.harness.tiny import TRAIN, rays_and_colours, train, trainer

every_candidate = pytest.mark.parametrize("method", CANDIDATES)


def mean_of(learner: Trainer) -> HeldMeanAmplifier:
    assert isinstance(learner.coarse.amplifier, HeldMeanAmplifier)
    return learner.coarse.amplifier


@every_candidate
def test_every_step_moves_it_and_nothing_else_does(method: str) -> None:
    learner = trainer(method)
    learner.warm_up(*rays_and_colours(seed=9))
    assert float(mean_of(learner).mean.steps) == 0.0
    train(learner, TRAIN.grid.first_step + 2)  # past the first refresh of the grid, which asks for densities as well
    assert float(mean_of(learner).mean.steps) == learner.step
    before = mean_of(learner).mean.value.clone()
    assert float(before) != 0.0
    learner.render(rays_and_colours(seed=3)[0], 16)
    learner.warm_up(*rays_and_colours(seed=3))
    assert learner.grid is not None
    learner.grid.refresh(learner.coarse, 1.0, torch.Generator().manual_seed(1))
    assert torch.equal(mean_of(learner).mean.value, before)


@every_candidate
def test_a_step_that_diverges_leaves_it_where_it_was(method: str) -> None:
    learner = train(trainer(method), 3)
    before = mean_of(learner).mean.value.clone()
    rays, colours = rays_and_colours(seed=3)
    colours[0] = math.nan
    with pytest.raises(Diverged):
        learner.train_on(rays, colours)
    assert torch.equal(mean_of(learner).mean.value, before)
    assert float(mean_of(learner).mean.steps) == 3.0


@every_candidate
def test_alpha_is_reported_as_it_is_used(method: str) -> None:
    scalars = trainer(method).amplifier_scalars()
    assert scalars["alpha"] == pytest.approx(2.0 / (1.0 + math.sqrt(5.0)), rel=1e-6)
    assert (scalars["beta"] is not None) == hasattr(trainer(method).coarse.amplifier, "beta")


def test_the_coarse_and_the_fine_field_have_a_mean_each() -> None:
    learner = train(trainer("qnerf_running_mean", settings=replace(TRAIN, fine_bins=8)), 2)
    assert learner.fine is not None
    fine = learner.fine.amplifier
    assert isinstance(fine, HeldMeanAmplifier)
    assert float(fine.mean.steps) == float(mean_of(learner).mean.steps) == 2.0
    assert not torch.equal(fine.mean.value, mean_of(learner).mean.value)
