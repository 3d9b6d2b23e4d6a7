"""Reduced precision is only for multiplications; a gradient is clipped, and numbers that are not finite refused."""

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from baselines import field, rendering
from baselines.contract import DTYPES, Precision, Rays
from baselines.numerics.quadrature import QUADRATURES
from harness.plan.settings import GridSettings
from harness.training import trainer as trainer_module
from harness.training.learner import SPIKE, Clipping
from harness.training.trainer import LOSS_SCALE, Diverged, Trainer
from tests.harness.tiny import TRAIN, rays_and_colours, train, trainer

REDUCED: list[Precision] = ["bfloat16", "float16"]
every_reduced = pytest.mark.parametrize("precision", REDUCED)


def dtypes_of(values: Any) -> set[torch.dtype]:
    tensors = values if isinstance(values, tuple) else (values,)
    return {one.dtype for one in tensors if isinstance(one, Tensor) and one.is_floating_point()}


def trained(precision: Precision, steps: int = 3, method: str = "qnerf", **changes: Any) -> Trainer:
    return train(trainer(method, replace(TRAIN, precision=precision, **changes)), steps)


@every_reduced
@pytest.mark.parametrize("method", ["nerf", "qnerf", "qnerf_theorem", "qnerf_listing4"])
def test_weights_moments_encoding_amplifier_and_quadrature_are_float32(
    precision: Precision, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, set[torch.dtype]] = {"encoding": set(), "quadrature": set(), "amplifier": set(), "products": set()}

    def watched(name: str, whole: Any) -> Any:
        def call(*arguments: Any) -> Any:
            result = whole(*arguments)
            for value in (*arguments, result):
                seen[name] |= dtypes_of(value)
            return result

        return call

    learner = trainer(method, replace(TRAIN, precision=precision))
    monkeypatch.setattr(field, "encode", watched("encoding", field.encode))
    rules = {name: replace(rule, weights=watched("quadrature", rule.weights)) for name, rule in QUADRATURES.items()}
    monkeypatch.setattr(rendering, "QUADRATURES", rules)
    amplifier = learner.coarse.amplifier
    for name in ("before_and_after", "rendered"):
        monkeypatch.setattr(amplifier, name, watched("amplifier", getattr(amplifier, name)))
    monkeypatch.setattr(field, "linear", watched("products", field.linear))
    train(learner, 3)
    learner.render(rays_and_colours()[0], 16)
    assert seen == {
        "encoding": {torch.float32},
        "quadrature": {torch.float32},
        "amplifier": {torch.float32},
        "products": {DTYPES[precision]},
    }
    state = list(learner.optimiser.tensors().values())
    assert {weight.dtype for weight in learner.fields.parameters()} == dtypes_of(tuple(state)) == {torch.float32}


@every_reduced
def test_weights_move_by_less_than_reduced_precision_resolves(precision: Precision) -> None:
    """A step of 1e-5 at a weight of 1 is lost below float32."""
    learner = trainer(settings=replace(TRAIN, precision=precision, learning_rate=1e-5, last_learning_rate=1e-5))
    bias = learner.coarse.colour_net[0].bias
    with torch.no_grad():
        bias.fill_(1.0)
    train(learner, 10)
    moved = (bias.detach() - 1.0).abs()
    assert float(moved.max()) > 2e-5
    assert bool((bias.detach().to(DTYPES[precision]) == 1.0).all()), "the test would see nothing"


@every_reduced
def test_reduced_precision_trains_as_float32_does(precision: Precision) -> None:
    batch = rays_and_colours()
    losses = {}
    for kind in ("float32", precision):
        learner = trainer("nerf", replace(TRAIN, precision=kind, grid=GridSettings(cells=0)))
        for _ in range(24):
            learner.train_on(*batch)
        losses[kind] = learner.last_loss
    assert losses["float32"] is not None
    assert losses[precision] == pytest.approx(losses["float32"], rel=0.05)


def gradient_of(precision: Precision, faint: float) -> Tensor:
    """Return the gradient of all weights that the optimiser gets if every colour has the error `faint`."""
    learner = trainer("nerf", replace(TRAIN, precision=precision))
    rays, _ = rays_and_colours(256)
    found: list[Tensor] = []

    def noted(*_: Any) -> None:
        found.append(torch.cat([weight.grad.flatten() for weight in learner.fields.parameters()]))  # type: ignore[union-attr]

    learner.optimiser.step = noted  # type: ignore[method-assign]
    with torch.no_grad():
        seen = learner.render(rays, 256).colour
    learner.train_on(rays, seen + faint)
    return found[0]


def test_the_scaled_loss_keeps_gradients_that_float16_would_lose(monkeypatch: pytest.MonkeyPatch) -> None:
    exact = gradient_of("float32", 1e-4)
    scaled = gradient_of("float16", 1e-4)
    monkeypatch.setitem(LOSS_SCALE, "float16", 1.0)
    unscaled = gradient_of("float16", 1e-4)
    missed = [float((one - exact).norm() / exact.norm()) for one in (scaled, unscaled)]
    assert missed[0] < 0.03
    assert missed[1] > 3.0 * missed[0], "without the scale the test would see nothing"
    assert all(math.log2(scale).is_integer() for scale in trainer_module.LOSS_SCALE.values())


# what is refused


@pytest.mark.parametrize("part", ["origins", "directions"])
def test_a_ray_that_is_nan_is_named_instead_of_shown_as_background(part: str) -> None:
    learner = trained("float32", 1)
    rays, colours = rays_and_colours()
    values = {"origins": rays.origins.clone(), "directions": rays.directions.clone()}
    values[part][13, 2] = math.nan
    bad = Rays(**values, near=rays.near, far=rays.far)
    with pytest.raises(ValueError, match="ray 13 is not finite: origin"):
        learner.render(bad, 1000)
    with pytest.raises(ValueError, match="ray 13 is not finite"):
        learner.train_on(bad, colours)


def test_the_ray_whose_pixel_is_not_finite_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    learner = trained("float32", 1, "nerf")
    whole = learner.coarse.density_and_colour

    def spoilt(x: Tensor, view: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
        sigma, colour = whole(x, view, ray)
        return sigma, torch.where((ray == 5).unsqueeze(-1), math.nan, colour)

    monkeypatch.setattr(learner.coarse, "density_and_colour", spoilt)
    with pytest.raises(Diverged, match=r"at step 1: rendered colour of ray 5$"):
        learner.render(rays_and_colours()[0], 1000)


@pytest.mark.parametrize("chunk", [16, 1000])
def test_the_ray_whose_density_is_nan_is_named(chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rays are counted over all chunks."""
    learner = trained("float32", 1, "nerf")
    rays, colours = rays_and_colours()
    whole = learner.coarse.density_and_colour
    wanted = learner.coarse.encode_directions(rays.directions)[21]

    def spoilt(x: Tensor, view: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
        sigma, colour = whole(x, view, ray)
        return torch.where(torch.isclose(view, wanted).all(dim=-1)[ray], math.nan, sigma), colour

    monkeypatch.setattr(learner.coarse, "density_and_colour", spoilt)
    for use in (lambda: learner.render(rays, chunk), lambda: learner.train_on(rays, colours)):
        with pytest.raises(Diverged, match=r"at step 1: density of sample \d+ of ray 21$"):
            use()


def test_a_weight_that_a_step_makes_infinite_is_named_at_that_step(monkeypatch: pytest.MonkeyPatch) -> None:
    learner = trained("float32", 2)
    step = learner.optimiser.step

    def too_far(rate: float) -> None:
        step(rate)
        with torch.no_grad():
            learner.coarse.density_net[1].bias[3] = math.inf

    monkeypatch.setattr(learner.optimiser, "step", too_far)
    with pytest.raises(Diverged, match=r"at step 2: weight of coarse\.density_net\.1\.bias"):
        learner.train_on(*rays_and_colours())


def test_large_finite_weights_are_no_divergence() -> None:
    """Only their squares overflow."""
    weights = [torch.tensor([1e30, -1e30]), torch.tensor(3.0)]
    assert trainer_module._all_finite(weights)
    assert not trainer_module._all_finite([*weights, torch.tensor([math.nan])])


def test_the_trace_holds_the_norm_before_and_after_clipping() -> None:
    for limit in (1e-9, 1e-4, 1e9):  # the smallest as well: no small number is added to what the norm is divided by
        learner = trained("float32", 1, clip_norm=limit)
        before, after = (learner.trace[name][0] for name in ("gradient_norm", "clipped_norm"))
        assert before is not None
        assert after == pytest.approx(min(before, limit), rel=1e-5)
        assert learner.clipping.clipped_steps == (before > limit)
    assert learner.last_loss == learner.trace["loss"][0]


def spiked(factor: float, at: int, **changes: float) -> tuple[list[float], list[float]]:
    """Return the norms that the optimiser got, and the running mean after each step."""
    learner = trainer("nerf", replace(TRAIN, grid=GridSettings(cells=0), **changes))  # type: ignore[arg-type]
    given: list[float] = []
    usual: list[float] = []
    for weight in learner.fields.parameters():
        weight.register_hook(lambda gradient: gradient * factor if learner.step == at else gradient)
    step_of = learner.optimiser.step

    def noting(rate: float) -> None:
        given.append(float(torch.nn.utils.get_total_norm([w.grad for w in learner.fields.parameters()])))  # type: ignore[misc]
        step_of(rate)

    learner.optimiser.step = noting  # type: ignore[method-assign]
    for step in range(at + 3):
        learner.train_on(*rays_and_colours(seed=step))
        assert learner.clipping.usual_norm is not None
        usual.append(learner.clipping.usual_norm)
    return given, usual


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
def test_a_spike_reaches_the_optimiser_as_a_few_times_the_usual_norm_at_most(factor: float) -> None:
    given, usual = spiked(factor, 6)
    assert given[6] == pytest.approx(TRAIN.clip_ratio * usual[5], rel=1e-5)
    assert given[6] < 1.0
    assert usual[6] == pytest.approx(2.95 * usual[5], rel=1e-5)
    quiet, _ = spiked(1.0, 6)
    assert given[:6] == quiet[:6], "nothing is clipped before"
    alone, _ = spiked(factor, 6, clip_ratio=1e9)
    assert alone[6] == pytest.approx(1.0, rel=1e-5)


# how much of a gradient passes: at most a fixed norm and a multiple of the usual one, which no spike can poison


def fed(norms: list[float], bound: float = 1.0, ratio: float = 4.0) -> Clipping:
    clipping = Clipping(bound, ratio)
    for norm in norms:
        clipping.scale(norm)
    return clipping


@pytest.mark.parametrize("norm", [1e-30, 1e-6, 1.0, 1e6, 1e30])
@pytest.mark.parametrize("excess", [0.1, 1.0, 2.0, 1e6])
def test_what_is_allowed_passes_and_more_is_scaled_to_it(norm: float, excess: float) -> None:
    clipping = fed([norm], bound=math.inf)
    assert clipping.allowed == 4.0 * norm
    offered = excess * clipping.allowed
    assert clipping.scale(offered) * offered == pytest.approx(min(offered, 4.0 * norm), rel=1e-12)
    assert clipping.clipped_steps == (excess > 1.0)


def test_the_fixed_bound_holds_before_and_besides_the_usual_norm() -> None:
    clipping = fed([])
    assert (clipping.allowed, clipping.usual_norm) == (1.0, None)
    assert clipping.scale(0.0) == 1.0
    assert clipping.usual_norm is None
    assert clipping.scale(0.5) == 1.0
    assert (clipping.allowed, clipping.usual_norm) == (1.0, 0.5)
    assert clipping.scale(4.0) == 0.25


@pytest.mark.parametrize("height", [400.0, 1e3, 1e9, 1e300])
def test_a_spike_costs_a_bounded_rise_that_is_forgotten(height: float) -> None:
    quiet = 1e-3
    clipping = fed([quiet] * 50)
    assert clipping.scale(height * quiet) * height * quiet == pytest.approx(4.0 * quiet)
    risen = clipping.usual_norm
    assert risen is not None
    assert risen / quiet == pytest.approx(1.0 + (SPIKE * 4.0 - 1.0) / 20.0)
    assert risen / quiet == pytest.approx(2.95)
    for _ in range(60):
        assert clipping.scale(quiet) == 1.0
    assert clipping.usual_norm is not None
    assert clipping.usual_norm / quiet < 1.1, "1.95 · 0.95^n falls below 0.1 after 58 steps"
    assert clipping.clipped_steps == 1


def test_a_spike_as_the_very_first_gradient_is_forgotten_as_well() -> None:
    clipping = fed([1e9])
    assert clipping.usual_norm == SPIKE
    for _ in range(300):
        clipping.scale(1e-3)
    assert clipping.usual_norm is not None
    assert clipping.usual_norm < 1.01e-3


def test_a_lasting_rise_is_followed_within_a_few_steps() -> None:
    clipping = fed([1e-3] * 50)
    shares = [clipping.scale(0.8) for _ in range(12)]
    assert shares == sorted(shares)
    assert shares[0] == pytest.approx(0.004 / 0.8)
    assert shares[-1] == 1.0
    assert clipping.clipped_steps == shares.index(1.0) < 12


@pytest.mark.parametrize("height", [30.0, 100.0, 300.0])
def test_rare_batches_that_come_again_keep_their_weight(height: float) -> None:
    """One in ten has a far larger norm. Its share of the mean is a tenth of it, of which four times pass."""
    quiet = 1e-3
    rounds = [*[quiet] * 9, height * quiet]
    clipping = fed(rounds * 20, bound=math.inf)
    for norm in rounds[:-1]:
        assert clipping.scale(norm) == 1.0
    assert clipping.scale(height * quiet) > 0.3
