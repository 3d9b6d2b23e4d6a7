"""One method in training: it is bit-identical when repeated, stops at a NaN, and runs on its own clock."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from typing import Any

import pytest
import torch

from baselines.amplifiers import HeldMeanAmplifier
from baselines.composition import LOSSES
from baselines.methods.repaired import CANDIDATES
from harness.machine.stopwatch import Stopwatch
from harness.plan.schedule import Budget, learning_rate
from harness.plan.settings import GridSettings, TrainSettings
from harness.training.trainer import LAYER, TRACED, Diverged, Trainer, _all_finite
from tests.harness.patching import changed, preceded
from tests.harness.tiny import BUDGET, CPU, OWN, TRAIN, rays_and_colours, same, train, trainer, weights
from tests.harness.voxels import voxels

every_kind = pytest.mark.parametrize("method", ["nerf", *CANDIDATES, "voxels_drjit"])


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


@every_kind
def test_the_warm_up_changes_nothing_and_is_not_on_the_clock(method: str) -> None:
    """Nine steps: over both refinements of the voxels."""
    plain, warmed = learner_of(method), learner_of(method)
    warmed.warm_up(*rays_and_colours(seed=3))
    assert (warmed.clock.seconds, warmed.step, warmed.network_evaluations) == (0.0, 0, 0)
    assert same(weights(plain), weights(warmed))
    assert same(weights(train(plain, 9)), weights(train(warmed, 9)))


def test_the_optimiser_is_made_before_the_clock_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Adam's import takes 5 s."""
    learner = trainer()
    learner.warm_up(*rays_and_colours(seed=3))
    monkeypatch.setattr("harness.training.trainer.optimiser_of", None)
    train(learner, 2)


@every_kind
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
    first, second = trainer(seed=0), trainer(seed=1)
    assert not same(weights(first), weights(second))
    second.fields.load_state_dict(first.fields.state_dict())
    assert not same(weights(train(first, 1)), weights(train(second, 1)))


# what is not finite

Patch = pytest.MonkeyPatch


def of_ray_21(learner: Trainer, view: torch.Tensor) -> torch.Tensor:
    """Say of each encoded direction whether it is that of ray 21, in whatever chunk."""
    wanted = learner.coarse.encode_directions(rays_and_colours()[0].directions)[21]
    return torch.isclose(view, wanted).all(dim=-1)


def spoilt_density(learner: Trainer, patch: Patch) -> None:
    def spoil(whole: Any, x: torch.Tensor, view: torch.Tensor, ray: torch.Tensor) -> Any:
        return torch.where(of_ray_21(learner, view)[ray], math.nan, whole[0]), whole[1]

    changed(patch, learner.coarse, "density_and_colour", spoil)


def spoilt_colour(learner: Trainer, patch: Patch) -> None:
    def spoil(whole: Any, x: torch.Tensor, view: torch.Tensor, ray: torch.Tensor) -> Any:
        return whole[0], torch.where((ray == 5).unsqueeze(-1), math.nan, whole[1])

    changed(patch, learner.coarse, "density_and_colour", spoil)


def spoilt_cell(learner: Trainer, patch: Patch) -> None:
    changed(patch, learner.coarse, "density", lambda sigma, x: sigma.where(torch.arange(len(x)) != 3, math.nan))


def spoilt_depth(learner: Trainer, patch: Patch) -> None:
    changed(patch, learner, "_rendered", lambda whole, *_: replace(whole, depth=whole.depth / 0.0))


def spoilt_gradient(learner: Trainer, patch: Patch) -> None:
    learner.coarse.density_head.weight.register_hook(lambda gradient: gradient * math.nan)


def spoilt_weight(learner: Trainer, patch: Patch) -> None:
    changed(patch, learner.optimiser, "step", lambda *_: learner.coarse.density_net[1].bias.data.fill_(math.inf))


USES: dict[str, Callable[[Trainer], object]] = {
    "a step": lambda learner: learner.train_on(*rays_and_colours()),
    "a picture": lambda learner: learner.render(rays_and_colours()[0], 1000),
    "a picture in chunks": lambda learner: learner.render(rays_and_colours()[0], 16),
}


@pytest.mark.parametrize(
    ("spoil", "steps", "use", "said"),
    [
        (spoilt_gradient, 1, "a step", "gradient of coarse.density_head.weight"),
        (spoilt_weight, 2, "a step", "weight of coarse.density_net.1.bias"),
        (spoilt_cell, 10, "a step", "density in the occupancy grid"),
        (spoilt_colour, 1, "a picture", "rendered colour of ray 5$"),
        (spoilt_depth, 1, "a picture in chunks", "rendered depth"),
        *((spoilt_density, 1, use, r"density of sample \d+ of ray 21$") for use in USES),
    ],
)
def test_what_is_not_finite_is_named_and_leaves_the_weights_alone(
    spoil: Callable[[Trainer, Patch], None], steps: int, use: str, said: str, monkeypatch: Patch
) -> None:
    """Rays are counted over all chunks; only a weight that is not finite itself has changed."""
    learner = train(trainer(), steps)
    before = weights(learner)
    spoil(learner, monkeypatch)
    with pytest.raises(Diverged, match=f"at step {steps}: {said}"):
        USES[use](learner)
    assert same(weights(learner), before) is (spoil is not spoilt_weight)


@pytest.mark.parametrize("part", ["origins", "directions"])
def test_a_ray_that_is_nan_is_named_instead_of_shown_as_background(part: str) -> None:
    learner = train(trainer(), 1)
    rays, colours = rays_and_colours()
    bad = replace(rays, **{part: getattr(rays, part).clone()})
    getattr(bad, part)[13, 2] = math.nan
    for use in (lambda: learner.render(bad, 1000), lambda: learner.train_on(bad, colours)):
        with pytest.raises(ValueError, match="ray 13 is not finite: origin"):
            use()


def test_large_finite_weights_are_no_divergence() -> None:
    """Only their squares overflow."""
    weights = [torch.tensor([1e30, -1e30]), torch.tensor(3.0)]
    assert _all_finite(weights)
    assert not _all_finite([*weights, torch.tensor([math.nan])])


# rendering


@pytest.mark.parametrize("method", ["nerf", "qnerf", "qnerf_theorem", "qnerf_listing4"])
def test_no_rays_are_no_pixels(method: str) -> None:
    nothing = trainer(method).render(rays_and_colours(0)[0], 16)
    assert (nothing.colour.shape, nothing.opacity.shape, nothing.depth.shape) == ((0, 3), (0,), (0,))


# optimiser, schedule, grid


SLOWER = replace(OWN["nerf"], learning_rate=3e-2, last_learning_rate=1e-4, decay="linear", warm_up_steps=2)


@pytest.mark.parametrize(
    ("settings", "schedule"),
    [(TRAIN, (1e-2, 1e-3, 5, TRAIN.decay)), (replace(TRAIN, own={"nerf": SLOWER}), (3e-2, 1e-4, 2, "linear"))],
)
def test_the_learning_rate_follows_the_schedule_of_the_run_or_of_the_method(
    settings: TrainSettings, schedule: tuple[Any, ...]
) -> None:
    learner = trainer(settings=settings)
    rates: list[float] = []
    learner.optimiser.step = rates.append  # type: ignore[method-assign]
    train(learner, 24)
    assert rates == [learning_rate(step / 24, step, *schedule) for step in range(24)]
    assert learner.progress == 1.0


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


def test_the_grid_is_measured_whole_once_and_then_in_parts_on_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    learner, ticks = trainer(), count()
    learner.clock = Stopwatch(CPU, lambda: float(next(ticks)))
    seen: list[tuple[int, float]] = []

    def note(field: Any, share: float, generator: torch.Generator) -> None:
        seen.append((learner.step, share))
        for _ in range(100):
            next(ticks)

    preceded(monkeypatch, learner.grid, "refresh", note)
    before = train(learner, 10).network_evaluations
    assert train(learner, 1).network_evaluations - before > 8**3
    train(learner, 13)
    assert seen == [(10, 1.0), (15, 0.25), (20, 0.25)]
    assert learner.clock.seconds == 24 + 3 * 100


NO_GRID = replace(TRAIN, grid=GridSettings(cells=0))


@pytest.mark.parametrize(
    ("settings", "points"),
    [(TRAIN, TRAIN.first_bins), (NO_GRID, TRAIN.bins), (replace(NO_GRID, fine_bins=8), 2 * TRAIN.bins + 8)],
)
def test_every_ray_is_sampled_fully_without_a_grid_and_before_it_is_in_use(
    settings: TrainSettings, points: int
) -> None:
    learner = train(trainer(settings=settings), 2)
    assert learner.network_evaluations == 2 * 64 * points
    assert learner.trace["samples_per_ray"] == [points]


def test_the_grid_can_be_switched_off_and_listing_4_has_none() -> None:
    assert trainer(settings=NO_GRID).grid is None
    assert trainer("qnerf_listing4").grid is None


def test_a_fine_pass_trains_both_fields_and_shows_the_fine_one() -> None:
    learner = trainer(settings=replace(NO_GRID, fine_bins=8))
    assert learner.field is learner.fine
    before = weights(learner)
    train(learner, 2)
    changed = {name for name, value in weights(learner).items() if not torch.equal(value, before[name])}
    assert {name.partition(".")[0] for name in changed} == {"coarse", "fine"}


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


@pytest.mark.parametrize("bins", [0, -1])
def test_less_than_one_bin_a_ray_is_refused(bins: int) -> None:
    with pytest.raises(ValueError, match=f"{bins} bins per ray"):
        trainer().render(rays_and_colours(8)[0], 8, bins)


# a mean that belongs to the field: moved by the steps of a training and by nothing else


def mean_of(learner: Trainer) -> HeldMeanAmplifier:
    assert isinstance(learner.coarse.amplifier, HeldMeanAmplifier)
    return learner.coarse.amplifier


@pytest.mark.parametrize("method", CANDIDATES)
def test_every_step_moves_it_and_the_grid_does_not(method: str) -> None:
    learner = train(trainer(method), TRAIN.grid.first_step + 2)
    assert float(mean_of(learner).mean.steps) == learner.step
    before = mean_of(learner).mean.value.clone()
    assert float(before) != 0.0
    learner.grid.refresh(learner.coarse, 1.0, torch.Generator().manual_seed(1))
    assert torch.equal(mean_of(learner).mean.value, before)


def test_the_coarse_and_the_fine_field_have_a_mean_each() -> None:
    learner = train(trainer("qnerf_running_mean", settings=replace(TRAIN, fine_bins=8)), 2)
    fine = learner.fine.amplifier
    assert isinstance(fine, HeldMeanAmplifier)
    assert float(fine.mean.steps) == float(mean_of(learner).mean.steps) == 2.0
    assert not torch.equal(fine.mean.value, mean_of(learner).mean.value)
