"""One method in training: it is bit-identical when repeated, stops at a NaN, and runs on its own clock."""

import math
from dataclasses import replace
from typing import Any

import pytest
import torch

from baselines.amplifiers import HeldMeanAmplifier
from baselines.composition import LOSSES
from baselines.methods.repaired import CANDIDATES
from baselines.numerics.optimisers import Optimiser, optimiser_of
from harness.machine.stopwatch import Stopwatch
from harness.plan.schedule import Budget, learning_rate
from harness.plan.settings import GridSettings
from harness.training.trainer import LAYER, TRACED, Diverged, Trainer
from tests.harness.tiny import BUDGET, CPU, OWN, TRAIN, rays_and_colours, same, train, trainer, weights
from tests.harness.voxels import voxels

METHODS = ["nerf", "qnerf", "qnerf_theorem", "qnerf_listing4"]
every_kind = pytest.mark.parametrize("method", ["nerf", "voxels_drjit"])


def learner_of(method: str) -> Any:
    return voxels() if method == "voxels_drjit" else trainer(method)


@pytest.mark.parametrize("method", ["nerf", "qnerf", *CANDIDATES, "voxels_drjit"])
def test_the_same_seed_gives_the_same_bits(method: str) -> None:
    first = train(learner_of(method), 22)
    torch.manual_seed(1234)
    second = train(learner_of(method), 22)
    assert same(weights(first), weights(second))
    assert first.trace == second.trace
    assert first.network_evaluations == second.network_evaluations
    rays, _ = rays_and_colours(seed=77)
    assert torch.equal(first.render(rays, 16).colour, second.render(rays, 16).colour)


@every_kind
def test_rendering_between_steps_and_in_chunks_changes_nothing(method: str) -> None:
    alone, looked_at = train(learner_of(method), 12), learner_of(method)
    for step in range(12):
        looked_at.render(rays_and_colours(seed=step)[0], 16)
        looked_at.train_on(*rays_and_colours(seed=step))
    assert same(weights(looked_at), weights(alone))
    rays, _ = rays_and_colours()
    whole = alone.render(rays, 10_000)
    for chunk in (1, 7, 64, 1000):
        parts = alone.render(rays, chunk)
        for name in ("colour", "opacity", "depth"):
            torch.testing.assert_close(getattr(parts, name), getattr(whole, name), atol=2e-5, rtol=1e-4)
        assert parts.network_evaluations == whole.network_evaluations


@pytest.mark.parametrize("method", ["nerf", *CANDIDATES, "voxels_drjit"])
def test_the_warm_up_changes_nothing_and_is_not_on_the_clock(method: str) -> None:
    """Nine steps: over both refinements of the voxels."""
    plain, warmed = learner_of(method), learner_of(method)
    warmed.warm_up(*rays_and_colours(seed=3))
    assert (warmed.clock.seconds, warmed.step, warmed.network_evaluations) == (0.0, 0, 0)
    assert same(weights(plain), weights(warmed))
    assert same(weights(train(plain, 9)), weights(train(warmed, 9)))


def test_the_optimiser_is_made_before_the_clock_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Adam's import takes 5 s."""
    made: list[object] = []

    def counted(*given: Any) -> Optimiser:
        made.append(given)
        return optimiser_of(*given)

    monkeypatch.setattr("harness.training.trainer.optimiser_of", counted)
    learner = trainer()
    learner.warm_up(*rays_and_colours(seed=3))
    assert len(made) == 1
    train(learner, 2)
    assert len(made) == 1


@pytest.mark.parametrize("method", ["nerf", *CANDIDATES, "voxels_drjit"])
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_colour_that_is_not_finite_shows_in_the_loss_and_leaves_the_weights_alone(method: str, bad: float) -> None:
    trained = train(learner_of(method), 2)
    before = weights(trained)
    rays, colours = rays_and_colours()
    colours[5, 1] = bad
    with pytest.raises(Diverged, match="at step 2: loss"):
        trained.train_on(rays, colours)
    assert same(weights(trained), before)
    assert trained.step == 2


def test_another_seed_gives_other_weights_and_other_samples() -> None:
    assert not same(weights(trainer(seed=0)), weights(trainer(seed=1)))
    first, second = trainer(seed=0), trainer(seed=1)
    second.fields.load_state_dict(first.fields.state_dict())
    assert not same(weights(train(first, 1)), weights(train(second, 1)))


# what is not finite


def test_a_gradient_that_is_nan_is_named_and_leaves_the_weights_alone() -> None:
    learner = train(trainer(), 1)
    before = weights(learner)
    learner.coarse.density_head.weight.register_hook(lambda gradient: gradient * math.nan)
    with pytest.raises(Diverged, match=r"at step 1: gradient of coarse\.density_head\.weight"):
        learner.train_on(*rays_and_colours())
    assert same(weights(learner), before)


def test_a_depth_that_is_not_finite_is_never_rendered(monkeypatch: pytest.MonkeyPatch) -> None:
    learner = trainer()
    whole = learner._rendered

    def spoilt(*arguments: Any) -> Any:
        rendering = whole(*arguments)
        return replace(rendering, depth=rendering.depth / 0.0)

    monkeypatch.setattr(learner, "_rendered", spoilt)
    with pytest.raises(Diverged, match="rendered depth"):
        learner.render(rays_and_colours()[0], 16)


def test_a_density_that_is_nan_in_the_grid_is_a_divergence(monkeypatch: pytest.MonkeyPatch) -> None:
    learner = train(trainer(), 10)
    whole = learner.coarse.density

    def spoilt(x: torch.Tensor) -> torch.Tensor:
        sigma = whole(x)
        sigma[3] = math.nan
        return sigma

    monkeypatch.setattr(learner.coarse, "density", spoilt)
    with pytest.raises(Diverged, match="at step 10: density in the occupancy grid"):
        train(learner, 1)


# rendering


@pytest.mark.parametrize("method", METHODS)
def test_no_rays_are_no_pixels(method: str) -> None:
    nothing = trainer(method).render(rays_and_colours(0)[0], 16)
    assert (nothing.colour.shape, nothing.opacity.shape, nothing.depth.shape) == ((0, 3), (0,), (0,))


# optimiser, schedule, grid


def test_the_learning_rate_follows_the_schedule() -> None:
    learner = trainer()
    rates: list[float] = []
    learner.optimiser.step = rates.append  # type: ignore[method-assign]
    for step in range(24):
        learner.train_on(*rays_and_colours(seed=step))
    assert rates == [learning_rate(step / 24, step, 1e-2, 1e-3, 5, TRAIN.decay) for step in range(24)]
    assert learner.progress == 1.0


def test_a_method_has_a_schedule_of_its_own() -> None:
    own = replace(OWN["nerf"], learning_rate=3e-2, last_learning_rate=1e-4, decay="linear", warm_up_steps=2)
    rates = train(trainer(settings=replace(TRAIN, own={"nerf": own})), 24).trace["learning_rate"]
    seen = (0, 19)  # the first step and every twentieth are traced
    assert rates == [learning_rate(step / 24, step, 3e-2, 1e-4, 2, "linear") for step in seen]


LOSS_OF_ERROR = {
    "squared": lambda error: error**2,
    "absolute": abs,
    "huber": lambda error: 0.5 * error**2 if abs(error) <= 0.1 else 0.1 * (abs(error) - 0.05),
}


@pytest.mark.parametrize("loss", LOSSES)
def test_a_method_has_a_loss_of_its_own(loss: str) -> None:
    own = {"nerf": replace(OWN["nerf"], loss=loss)}
    learner = trainer(settings=replace(TRAIN, own=own))
    rays, colours = rays_and_colours()
    seen: list[torch.Tensor] = []
    with pytest.MonkeyPatch.context() as patch:
        error = learner.error
        patch.setattr(learner, "error", lambda *pair: seen.extend(pair) or error(*pair))
        learner.train_on(rays, colours)
    rendered, truth = seen
    assert torch.equal(truth, colours)
    errors = (rendered.detach().double() - truth.double()).flatten().tolist()
    assert learner.last_loss == pytest.approx(sum(map(LOSS_OF_ERROR[loss], errors)) / len(errors), rel=1e-5)


def test_a_budget_ends_with_the_mean_of_its_weights_and_looking_at_it_before_changes_nothing() -> None:
    plain = trainer(settings=replace(TRAIN, average=0.0))
    learner, looked_at = trainer(), trainer()
    mean = {name: value.double() for name, value in weights(plain).items()}
    for step in range(1, BUDGET.steps or 0):
        for each in (plain, learner, looked_at):
            each.train_on(*rays_and_colours(seed=step))
        assert same(weights(learner), weights(plain)), "training goes on from the weights, not from their mean"
        share = 1.0 - (1.0 - 1.0 / step) ** (TRAIN.average + 1.0)
        mean = {name: value + share * (weights(plain)[name] - value) for name, value in mean.items()}
        with looked_at.averaged():
            for name, value in weights(looked_at).items():
                torch.testing.assert_close(value.double(), mean[name], atol=1e-6, rtol=1e-5)
            looked_at.render(rays_and_colours()[0], 16)
    for each in (learner, looked_at):
        each.train_on(*rays_and_colours(seed=0))
    assert learner.progress == 1.0
    assert same(weights(learner), weights(looked_at))
    plain.train_on(*rays_and_colours(seed=0))
    assert not same(weights(learner), weights(plain))
    ended = weights(learner)
    with learner.averaged():
        assert same(weights(learner), ended)


def test_the_grid_is_measured_whole_once_and_then_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    learner = trainer()
    seen: list[tuple[int, float]] = []
    original: Any = learner.grid.refresh  # type: ignore[union-attr]

    def spy(field: Any, share: float, generator: torch.Generator) -> int:
        seen.append((learner.step, share))
        return int(original(field, share, generator))

    monkeypatch.setattr(learner.grid, "refresh", spy)
    train(learner, 24)
    assert seen == [(10, 1.0), (15, 0.25), (20, 0.25)]


def test_refreshing_the_grid_is_on_the_clock_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    learner = train(trainer(), 10)
    ticks = iter(range(1000))
    learner.clock = Stopwatch(CPU, lambda: float(next(ticks)))
    assert learner.grid is not None
    original = learner.grid.refresh

    def slow(*arguments: Any) -> int:
        for _ in range(100):
            next(ticks)
        return original(*arguments)

    monkeypatch.setattr(learner.grid, "refresh", slow)
    before = learner.network_evaluations
    train(learner, 1)
    assert learner.clock.seconds == 101
    assert learner.network_evaluations - before > 8**3


def test_every_ray_is_sampled_fully_before_the_grid_is_in_use() -> None:
    learner = train(trainer(), 1)
    assert learner.network_evaluations == 64 * TRAIN.first_bins
    assert learner.trace["samples_per_ray"] == [TRAIN.first_bins]


def test_the_grid_can_be_switched_off_and_listing_4_has_none() -> None:
    assert trainer(settings=replace(TRAIN, grid=GridSettings(cells=0))).grid is None
    assert trainer("qnerf_listing4").grid is None
    without = train(trainer(settings=replace(TRAIN, grid=GridSettings(cells=0))), 2)
    assert without.network_evaluations == 2 * 64 * TRAIN.bins


def test_a_fine_pass_trains_both_fields_and_shows_the_fine_one() -> None:
    learner = trainer(settings=replace(TRAIN, fine_bins=8, grid=GridSettings(cells=0)))
    assert learner.fine is not None
    assert learner.field is learner.fine
    before = weights(learner)
    train(learner, 2)
    changed = {name for name, value in weights(learner).items() if not torch.equal(value, before[name])}
    assert {name.partition(".")[0] for name in changed} == {"coarse", "fine"}
    assert learner.network_evaluations == 2 * 64 * (TRAIN.bins + TRAIN.bins + 8)


# budget and trace


def test_the_trace_has_series_of_one_length() -> None:
    learner = train(trainer("qnerf", budget=Budget(45, None)), 45)
    layers = {name.removeprefix(LAYER) for name in learner.trace if name.startswith(LAYER)}
    assert set(learner.trace) - {LAYER + name for name in layers} == set(TRACED)
    assert {"density_net.0", "density_head", "colour_net.0", "amplifier.alpha"} <= layers
    squares = [sum((learner.trace[LAYER + name][at] or 0.0) ** 2 for name in layers) for at in range(3)]
    assert squares == pytest.approx([(norm or 0.0) ** 2 for norm in learner.trace["gradient_norm"]], rel=1e-5)
    rates = learner.trace["learning_rate"]
    assert all(0.0 < (rate or 0.0) <= TRAIN.learning_rate for rate in rates)
    assert learner.trace["step"] == [1.0, 20.0, 40.0]
    assert {len(series) for series in learner.trace.values()} == {3}
    assert learner.trace["alpha"][0] == pytest.approx(0.618, abs=0.02)
    assert train(trainer("nerf"), 1).trace["alpha"] == [None]
    assert trainer("nerf").amplifier_scalars() == {"alpha": None, "beta": None}


@pytest.mark.parametrize("bins", [0, -1])
def test_less_than_one_bin_a_ray_is_refused(bins: int) -> None:
    with pytest.raises(ValueError, match=f"{bins} bins per ray"):
        trainer().render(rays_and_colours(8)[0], 8, bins)


# a mean that belongs to the field: moved by the steps of a training and by nothing else

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
