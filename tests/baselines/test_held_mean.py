"""A mean that belongs to the field: only training steps move it, independent of the calls within them."""

import pytest
import torch
from torch import Tensor

from baselines.amplifiers import AMPLIFIERS, HeldMeanAmplifier
from baselines.field import training_step
from baselines.held_mean import MEAN_SHARE, RunningMean
from baselines.methods.repaired import CANDIDATES
from tests.baselines.small_fields import field_of, roughened, some_points


def moved_by(mean: RunningMean, *steps: list[Tensor]) -> RunningMean:
    for calls in steps:
        mean.begin()
        for values in calls:
            mean.observe(values)
        mean.update()
    return mean


def test_the_first_steps_average_and_later_ones_fade() -> None:
    found, expected = RunningMean(), 0.0
    for step in range(40):
        moved_by(found, [torch.full((7,), float(step % 5), requires_grad=True)])
        assert not found.value.requires_grad
        share = max(1.0 / (step + 1), MEAN_SHARE)
        expected += share * (step % 5 - expected)
        assert float(found.value) == pytest.approx(expected, rel=1e-6)
    assert float(moved_by(RunningMean(), [torch.ones(3)], [3 * torch.ones(3)]).value) == 2.0


def test_it_does_not_matter_in_how_many_calls_the_values_of_a_step_come() -> None:
    values = 50.0 * torch.rand(1000, generator=torch.Generator().manual_seed(3)) ** 8
    whole = moved_by(RunningMean(), [values]).value
    for size in (1, 7, 256, 999):
        assert torch.equal(moved_by(RunningMean(), list(values.split(size))).value, whole), size
    shuffled = values[torch.randperm(1000, generator=torch.Generator().manual_seed(4))]
    assert torch.equal(moved_by(RunningMean(), [shuffled]).value, whole)


def test_nothing_counts_outside_of_a_step_nor_in_one_that_is_dropped_or_saw_nothing() -> None:
    mean = moved_by(RunningMean(), [torch.full((3,), 2.0)])
    mean.observe(torch.full((3,), 9.0))
    mean.begin()
    mean.observe(torch.full((3,), 9.0))
    mean.drop()
    mean.update()
    moved_by(mean, [], [torch.zeros(0)])
    assert (float(mean.value), float(mean.steps)) == (2.0, 1.0)


@pytest.mark.parametrize("method", CANDIDATES)
def test_a_step_of_training_moves_the_mean_to_that_of_what_it_evaluated(method: str) -> None:
    field = roughened(field_of(method))
    x, d, ray = some_points(300)
    amplifier = field.amplifier
    assert isinstance(amplifier, HeldMeanAmplifier)
    with training_step([field]):
        field.density_and_colour(x, field.encode_directions(d), ray)
    with torch.no_grad():
        expected = amplifier.quantity(field._outputs(x, None, None)[0]).mean()
    torch.testing.assert_close(amplifier.mean.value, expected, rtol=1e-5, atol=0.0)


@pytest.mark.parametrize("method", CANDIDATES)
def test_training_and_rendering_see_the_same_field_in_whatever_calls(method: str) -> None:
    field, x = roughened(field_of(method), alpha=0.9), some_points(200)[0]
    with training_step([field]):
        field.density(some_points(400)[0])
    with torch.no_grad():
        rendered = field.density(x)
    with training_step([field]):
        trained = torch.cat([field.density(x[:50]), field.density(x[50:])])
    torch.testing.assert_close(trained.detach(), rendered, rtol=1e-5, atol=1e-5)


def test_every_reading_about_a_held_mean_is_a_candidate() -> None:
    """A reading that is added after the search needs another search."""
    held = {name for name, make in AMPLIFIERS.items() if isinstance(make(None), HeldMeanAmplifier)}
    assert held == {parts.amplifier for parts in CANDIDATES.values()}


@pytest.mark.parametrize("method", ["qnerf", "qnerf_printed", "qnerf_theorem"])
@torch.no_grad()
def test_whoever_asks_for_density_alone_sees_the_field_that_training_rendered(method: str) -> None:
    """The grid and the histogram ask about points whose mean is not that of the rendered ones."""
    field = roughened(field_of(method), alpha=2.0)
    x, d, ray = some_points(400)
    with training_step([field]):
        rendered, _ = field.density_and_colour(x, field.encode_directions(d), ray)
    torch.testing.assert_close(field.density(x), rendered, rtol=1e-4, atol=1e-4)
    few = field.density(x[:40])
    torch.testing.assert_close(few, rendered[:40], rtol=1e-4, atol=1e-4)
    alone, _ = field.density_and_colour(x[:40], field.encode_directions(d), ray[:40])
    assert not torch.allclose(few, alone, rtol=1e-3), "the mean of 40 points must differ from that of 400"
    torch.testing.assert_close(field.density(x[:40]), few)
