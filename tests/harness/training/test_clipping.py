"""How much of a gradient passes: at most a fixed norm and a multiple of the usual one, which no spike can poison."""

import math

import pytest

from harness.training.learner import SPIKE, Clipping


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
