"""Reduced precision is only for multiplications; a gradient is clipped."""

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from baselines import field, rendering
from baselines.contract import DTYPES, Precision
from baselines.numerics.quadrature import QUADRATURES
from harness.plan.settings import GridSettings
from harness.training.learner import SPIKE, Clipping
from harness.training.trainer import LOSS_SCALE
from tests.harness.tiny import TRAIN, rays_and_colours, train, trainer

REDUCED: list[Precision] = ["bfloat16", "float16"]
every_reduced = pytest.mark.parametrize("precision", REDUCED)


def dtypes_of(values: Any) -> set[torch.dtype]:
    tensors = values if isinstance(values, tuple) else (values,)
    return {one.dtype for one in tensors if isinstance(one, Tensor) and one.is_floating_point()}


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
def test_reduced_precision_trains_as_float32_does(precision: Precision) -> None:
    batch = rays_and_colours()
    losses = {}
    for kind in ("float32", precision):
        learner = trainer(settings=replace(TRAIN, precision=kind, grid=GridSettings(cells=0)))
        for _ in range(24):
            learner.train_on(*batch)
        losses[kind] = learner.last_loss
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
    assert all(math.log2(scale).is_integer() for scale in LOSS_SCALE.values())


# gradients are clipped


@pytest.mark.parametrize("limit", [1e-9, 1e-4, 1e9])
@pytest.mark.parametrize("usual", [None, 1e-7])
def test_the_optimiser_gets_the_norm_that_is_allowed_and_the_trace_holds_both(
    limit: float, usual: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The smallest limit as well: no small number is added to what the norm is divided by."""
    learner = trainer(settings=replace(TRAIN, clip_norm=limit))
    learner.clipping.usual_norm = usual
    allowed = limit if usual is None else min(limit, TRAIN.clip_ratio * usual)
    given: list[float] = []

    def noted(rate: float) -> None:
        gradients = [weight.grad for weight in learner.fields.parameters()]
        given.append(float(torch.nn.utils.get_total_norm(gradients)))  # type: ignore[arg-type]

    monkeypatch.setattr(learner.optimiser, "step", noted)
    train(learner, 1)
    before, after = (learner.trace[name][0] for name in ("gradient_norm", "clipped_norm"))
    assert given == pytest.approx([after], rel=1e-5)
    assert after == pytest.approx(min(before, allowed), rel=1e-5)
    assert learner.clipping.clipped_steps == (before > allowed)
    assert learner.last_loss == learner.trace["loss"][0]


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
    offered = excess * float(clipping.allowed)
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
    assert risen / quiet == pytest.approx(2.95), "1 + (10 · 4 − 1) / 20"
    for _ in range(60):
        assert clipping.scale(quiet) == 1.0
    assert clipping.usual_norm / quiet < 1.1, "1.95 · 0.95^n falls below 0.1 after 58 steps"
    assert clipping.clipped_steps == 1


def test_a_spike_as_the_very_first_gradient_is_forgotten_as_well() -> None:
    clipping = fed([1e9])
    assert clipping.usual_norm == SPIKE
    for _ in range(300):
        clipping.scale(1e-3)
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
