"""What every candidate for the repaired Q-NeRF must be: Eq. 4, opaque, a field, finite, and kept in a checkpoint."""

import math
from itertools import product

import pytest
import torch

from baselines.amplifiers import AMPLIFIERS, HeldMeanAmplifier, NoAmplifier
from baselines.composition import DENSITY_SCALE
from baselines.field import NetworkField, training_step
from baselines.methods.repaired import CANDIDATES
from baselines.numerics.encoding import PHI
from tests.baselines.small_fields import field_of, roughened, set_alpha, some_points

READINGS = [parts.amplifier for parts in CANDIDATES.values()]
every_candidate = pytest.mark.parametrize("method", CANDIDATES)
every_reading = pytest.mark.parametrize("reading", READINGS)


START = 0.012


def made(reading: str, alpha: float = 1.0 / PHI, mean: float = 0.0, beta: float = 1.0) -> HeldMeanAmplifier:
    amplifier = AMPLIFIERS[reading](START)
    assert isinstance(amplifier, HeldMeanAmplifier)
    set_alpha(amplifier, alpha)
    with torch.no_grad():
        amplifier.mean.value.fill_(mean)
        if hasattr(amplifier, "beta"):
            amplifier.beta.fill_(beta)  # type: ignore[operator]
    return amplifier


def settled(method: str) -> NetworkField:
    """As after training: the contrast has moved, and so has the mean."""
    field = roughened(field_of(method), alpha=0.9)
    with training_step([field]):
        field.density(some_points(400)[0])
    return field


@every_reading
def test_the_identity_at_first_to_the_last_bit_whatever_the_mean(reading: str) -> None:
    for mean in (0.0, 0.3, 17.0):
        before, after = made(reading, mean=mean).before_and_after(torch.linspace(-40.0, 40.0, 801))
        assert torch.equal(before, after)


def test_at_first_eq_4_is_the_density_of_nerf() -> None:
    raw = torch.linspace(-20.0, 12.0, 641)
    assert torch.equal(made("running_mean").before_and_after(raw)[1], NoAmplifier(START).before_and_after(raw)[1])


def slowly(reading: str, raw: float, alpha: float, mean: float, beta: float) -> float:
    """One density in double precision, from the formulas alone."""
    if reading == "running_mean_listing2":
        s = 1.0 / (1.0 + math.exp(-raw) * (1.0 - START) / START)
        amplified = mean + alpha * (s - mean) * PHI
        return min(max(amplified * (beta if s > 0.5 else 1.0), 0.0), 1.0)
    sigma = math.log1p(math.expm1(START) * math.exp(raw))
    return max(mean + alpha * (sigma - mean) * PHI, 0.0)


@every_reading
@pytest.mark.parametrize("alpha", [0.2, 0.9, 3.0])
def test_equation_4_point_by_point(reading: str, alpha: float) -> None:
    beta = 1.5 if "listing2" in reading else 1.0
    for mean in (0.05, 0.4, 0.9):
        raws = torch.linspace(-9.0, 14.0, 47)
        found = made(reading, alpha, mean, beta).before_and_after(raws)[1]
        expected = [slowly(reading, float(raw), alpha, mean, beta) for raw in raws]
        torch.testing.assert_close(found.detach(), torch.tensor(expected), rtol=1e-4, atol=1e-5)


@every_reading
def test_solid_matter_is_within_reach(reading: str) -> None:
    for alpha in (1.0 / PHI, 1.0, 2.0):
        sigma = DENSITY_SCALE * made(reading, alpha, mean=0.3).before_and_after(torch.tensor([1e3]))[1].item()
        assert -math.expm1(-sigma) >= 0.999, "half of the box"
        assert -math.expm1(-0.3 * sigma) >= 0.999, "a third of that too"


@every_candidate
def test_training_and_rendering_see_the_same_field(method: str) -> None:
    field, x = settled(method), some_points(200)[0]
    with torch.no_grad():
        rendered = field.density(x)
    with training_step([field]):
        trained = torch.cat([field.density(x[:50]), field.density(x[50:])])
    torch.testing.assert_close(trained.detach(), rendered, rtol=1e-5, atol=1e-5)


@every_reading
@pytest.mark.parametrize("alpha", [1.0 / PHI, -1.0, 0.0, 10.0, 1e3, math.inf])
def test_extremes_are_finite_with_finite_gradients(reading: str, alpha: float) -> None:
    decades = [0.0, *(sign * 10.0**k for k, sign in product(range(-45, 31, 3), (1.0, -1.0)))]
    for mean in (0.0, 0.5, 1e4):
        amplifier = made(reading, alpha, mean) if alpha > 0 and math.isfinite(alpha) else made(reading, mean=mean)
        if isinstance(weight := amplifier.alpha, torch.nn.Parameter):
            with torch.no_grad():
                weight.fill_(alpha)
        raw = torch.tensor(decades, requires_grad=True)
        before, after = amplifier.before_and_after(raw)
        after.sum().backward()
        for values in (before, after, raw.grad, *(one.grad for one in amplifier.parameters())):
            assert values is not None
            assert torch.isfinite(values).all()
        assert (after >= 0).all()


@every_reading
def test_gradients_are_those_of_differences(reading: str) -> None:
    amplifier = made(reading, 0.8, mean=0.3, beta=1.2).double()
    for value in (-1.0, 2.5, 5.0):
        weights = [torch.tensor([value], dtype=torch.float64, requires_grad=True), *amplifier.parameters()]
        amplifier.zero_grad()
        amplifier.before_and_after(weights[0])[1].sum().backward()
        for weight in weights:
            with torch.no_grad():
                pair = []
                for step in (1e-6, -2e-6):
                    weight += step
                    pair.append(float(amplifier.before_and_after(weights[0])[1]))
                weight += 1e-6
            assert weight.grad is not None
            assert float(weight.grad) == pytest.approx((pair[0] - pair[1]) / 2e-6, rel=1e-4, abs=1e-5)


@every_reading
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_refused(reading: str, dtype: torch.dtype) -> None:
    with pytest.raises(TypeError, match="the amplifier needs float32 or better, got torch"):
        made(reading).before_and_after(torch.zeros(4, dtype=dtype))
