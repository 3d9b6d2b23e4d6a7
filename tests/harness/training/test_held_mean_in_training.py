"""A mean that belongs to the field, in a real training: moved by its steps and by nothing else."""

import math
from dataclasses import replace

import pytest
import torch

from baselines.amplifiers import HeldMeanAmplifier
from baselines.methods.repaired import CANDIDATES
from harness.training.trainer import Diverged, Trainer
from tests.harness.tiny import TRAIN, rays_and_colours, same, train, trainer, weights

every_candidate = pytest.mark.parametrize("method", CANDIDATES)


def mean_of(one: Trainer) -> HeldMeanAmplifier:
    assert isinstance(one.coarse.amplifier, HeldMeanAmplifier)
    return one.coarse.amplifier


@every_candidate
def test_every_step_moves_it_and_nothing_else_does(method: str) -> None:
    one = trainer(method)
    one.warm_up(*rays_and_colours(seed=9))
    assert float(mean_of(one).mean.steps) == 0.0
    train(one, TRAIN.grid.first_step + 2)  # past the first refresh of the grid, which asks for densities as well
    assert float(mean_of(one).mean.steps) == one.step
    before = mean_of(one).mean.value.clone()
    assert float(before) != 0.0
    one.render(rays_and_colours(seed=3)[0], 16)
    one.warm_up(*rays_and_colours(seed=3))
    assert one.grid is not None
    one.grid.refresh(one.coarse, 1.0, torch.Generator().manual_seed(1))
    assert torch.equal(mean_of(one).mean.value, before)


@every_candidate
def test_the_same_seed_gives_the_same_bits_and_the_warm_up_leaves_no_trace(method: str) -> None:
    first, second = train(trainer(method), 13), trainer(method)
    second.warm_up(*rays_and_colours(seed=5))
    train(second, 13)
    assert same(weights(first), weights(second))


@every_candidate
def test_a_step_that_diverges_leaves_it_where_it_was(method: str) -> None:
    one = train(trainer(method), 3)
    before = mean_of(one).mean.value.clone()
    rays, colours = rays_and_colours(seed=3)
    colours[0] = math.nan
    with pytest.raises(Diverged):
        one.train_on(rays, colours)
    assert torch.equal(mean_of(one).mean.value, before)
    assert float(mean_of(one).mean.steps) == 3.0


@every_candidate
def test_alpha_is_reported_as_it_is_used(method: str) -> None:
    scalars = trainer(method).amplifier_scalars()
    assert scalars["alpha"] == pytest.approx(2.0 / (1.0 + math.sqrt(5.0)), rel=1e-6)
    assert (scalars["beta"] is not None) == hasattr(trainer(method).coarse.amplifier, "beta")


def test_the_coarse_and_the_fine_field_have_a_mean_each() -> None:
    one = train(trainer("qnerf_running_mean", settings=replace(TRAIN, fine_bins=8)), 2)
    assert one.fine is not None
    fine = one.fine.amplifier
    assert isinstance(fine, HeldMeanAmplifier)
    assert float(fine.mean.steps) == float(mean_of(one).mean.steps) == 2.0
    assert not torch.equal(fine.mean.value, mean_of(one).mean.value)
