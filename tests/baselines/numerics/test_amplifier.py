"""Every reading of the amplifier against its formula and the printed code, and in its limits."""

import math

import pytest
import torch
from torch import Tensor, nn

from baselines.amplifiers import AMPLIFIERS, Amplifier, HeldMeanAmplifier, Listing2Amplifier, MeanAmplifier
from baselines.composition import DENSITY_SCALE
from baselines.numerics.encoding import PHI

START = 0.012
HELD = [name for name, make in AMPLIFIERS.items() if isinstance(make(None), HeldMeanAmplifier)]
every_reading = pytest.mark.parametrize("reading", AMPLIFIERS)
every_held = pytest.mark.parametrize("reading", HELD)


def made(
    reading: str, alpha: float = 1.0 / PHI, mean: float = 0.0, beta: float = 1.0, start: float | None = START
) -> Amplifier:
    """Return the reading about that mean, as if training had taken a step."""
    amplifier = AMPLIFIERS[reading](start)
    with torch.no_grad():
        if isinstance(amplifier, MeanAmplifier):
            amplifier.mean.value.fill_(mean)
            amplifier.mean.steps.fill_(1.0)
        for name, value in (("alpha", alpha), ("beta", beta)):
            if hasattr(amplifier, name):
                getattr(amplifier, name).fill_(value)
    return amplifier


class Listing2(nn.Module):
    """Listing 2 of the paper, word for word."""

    def __init__(self, factor: float = PHI) -> None:
        super().__init__()
        self.amplification_factor = factor
        self.alpha = nn.Parameter(torch.tensor(1.0 / PHI))
        self.beta = nn.Parameter(torch.tensor(1.0))

    def forward(self, density: Tensor, threshold: float = 0.5) -> Tensor:
        density_norm = torch.sigmoid(density)
        mean_density = density_norm.mean()

        # Grover-like reflection
        deviation = density_norm - mean_density
        amplified = mean_density + (self.alpha * deviation * self.amplification_factor)

        # Threshold boost
        boost = torch.where(density_norm > threshold, self.beta, torch.ones_like(self.beta))
        return torch.clamp(amplified * boost, 0, 1)


@pytest.mark.parametrize("alpha", [1.0 / PHI, 0.0, -1.0, 1.0, 10.0])
@pytest.mark.parametrize("beta", [1.0, 0.5, 3.0])
def test_listing_2_is_the_printed_code_with_its_gradients(alpha: float, beta: float) -> None:
    printed, ours = Listing2(), Listing2Amplifier()
    raw = 3.0 * torch.randn(500, generator=torch.Generator().manual_seed(5))
    raws = [raw.clone().requires_grad_() for _ in range(2)]
    outputs = []
    for module, forward, raw in [(printed, printed, raws[0]), (ours, lambda r: ours.before_and_after(r)[1], raws[1])]:
        with torch.no_grad():
            module.alpha.fill_(alpha)
            module.beta.fill_(beta)
        outputs.append(forward(raw))
        (outputs[-1] * torch.linspace(-1, 1, 500)).sum().backward()
    torch.testing.assert_close(outputs[1], outputs[0], rtol=0.0, atol=1e-6)
    torch.testing.assert_close(raws[1].grad, raws[0].grad, rtol=1e-5, atol=1e-6)
    torch.testing.assert_close(ours.alpha.grad, printed.alpha.grad, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(ours.beta.grad, printed.beta.grad, rtol=1e-4, atol=1e-4)


def slowly(reading: str, raw: float, alpha: float, mean: float, beta: float) -> float:
    """Return one density in double precision, directly from the formulas."""
    if "listing2" in reading:
        s = 1.0 / (1.0 + math.exp(-raw) * (1.0 - START) / START)
        amplified = mean + alpha * (s - mean) * PHI
        return min(max(amplified * (beta if s > 0.5 else 1.0), 0.0), 1.0)
    sigma = math.log1p(math.expm1(START) * math.exp(raw))
    return sigma if reading == "none" else max(mean + alpha * (sigma - mean) * PHI, 0.0)


@every_reading
@pytest.mark.parametrize("alpha", [-1.0, 0.0, 0.2, 0.9, 3.0])
def test_every_reading_is_its_formula_point_by_point(reading: str, alpha: float) -> None:
    beta = 1.5 if "listing2" in reading else 1.0
    for mean in (0.05, 0.4, 0.9):
        raws = torch.linspace(-9.0, 14.0, 185)  # some just below the threshold
        found = made(reading, alpha, mean, beta).before_and_after(raws)[1]
        expected = [slowly(reading, float(raw), alpha, mean, beta) for raw in raws]
        torch.testing.assert_close(found.detach(), torch.tensor(expected), rtol=1e-4, atol=1e-5)


@every_reading
def test_at_first_a_reading_is_the_identity_whatever_the_mean(reading: str) -> None:
    """It is bit-identical about a held mean; the printed readings subtract the mean and add it again."""
    raw = torch.linspace(-40.0, 40.0, 801)
    for mean in (0.0, 0.3, 17.0):
        before, after = made(reading, mean=mean).before_and_after(raw)
        if reading in ("none", *HELD):
            assert torch.equal(before, after)
        elif mean <= 1.0:
            assert float((after - before).detach().abs().max() / before.max()) <= 1.2e-7
    assert torch.equal(made("running_mean").before_and_after(raw)[1], made("none").before_and_after(raw)[1])


@every_reading
def test_bounded_says_whether_density_stays_within_0_and_1(reading: str) -> None:
    amplifier = AMPLIFIERS[reading](None)
    assert amplifier.bounded == bool((amplifier.before_and_after(torch.linspace(-90.0, 90.0, 50))[1] <= 1.0).all())
    assert amplifier.before_and_after(torch.zeros(0))[1].shape == (0,), "no points are no points"


@every_held
def test_solid_geometry_is_within_reach(reading: str) -> None:
    for alpha in (1.0 / PHI, 1.0, 2.0):
        sigma = DENSITY_SCALE * made(reading, alpha, mean=0.3).before_and_after(torch.tensor([1e3]))[1].item()
        assert -math.expm1(-0.3 * sigma) >= 0.999, "a third of half of the box"


@every_reading
@pytest.mark.parametrize("start", [None, 1e-6, 0.012, 0.3, 0.9, 12.5, 1e3])
def test_a_fresh_field_has_its_start(reading: str, start: float | None) -> None:
    """Where the raw output is 0, density is the start in every reading, without one that of a raw output that is not
    shifted; a bounded reading cannot start above 1.
    """
    if start is not None and start >= 1.0 and AMPLIFIERS[reading](None).bounded:
        with pytest.raises(ValueError, match="a sigmoid lies between 0 and 1"):
            AMPLIFIERS[reading](start)
        return
    before, after = AMPLIFIERS[reading](start).before_and_after(torch.zeros(3))
    expected = start or (0.5 if "listing2" in reading else math.log(2.0))
    torch.testing.assert_close(after, torch.full((3,), expected), rtol=1e-5, atol=0.0)
    torch.testing.assert_close(before, after)


@every_reading
@pytest.mark.parametrize("start", [0.0, -1.0, float("nan")])
def test_a_start_that_is_no_density_is_refused(reading: str, start: float) -> None:
    with pytest.raises(ValueError, match="a start of"):
        AMPLIFIERS[reading](start)


@every_reading
@pytest.mark.parametrize("mean", [None, 0.0, 0.5, 1e4])
def test_sixty_decades_of_raw_density_are_finite_with_finite_gradients(reading: str, mean: float | None) -> None:
    """Readings with a held mean are tested at any contrast, also infinite α; the printed readings at the first α."""
    decades = [0.0, *(sign * 10.0**k for k in range(-45, 31, 3) for sign in (1.0, -1.0))]
    for alpha in (1.0 / PHI, -1.0, 0.0, 10.0, 1e3, math.inf) if reading in HELD else (1.0 / PHI,):
        for raw in (torch.tensor(decades), torch.full((500,), 1e30), torch.full((500,), -1e30)):
            amplifier = AMPLIFIERS[reading](None) if mean is None else made(reading, alpha, mean, start=None)
            values = amplifier.before_and_after(raw.requires_grad_())
            values[1].sum().backward()
            assert (values[1] >= 0).all()
            for each in (*values, raw.grad, *(weight.grad for weight in amplifier.parameters())):
                assert each is not None
                assert torch.isfinite(each).all()


@every_reading
def test_gradients_are_those_of_differences(reading: str) -> None:
    amplifier = made(reading, 0.8, mean=0.3, beta=1.2).double()
    raw = torch.tensor([-1.0, 2.5, 5.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(
        lambda raw, *_: amplifier.before_and_after(raw)[1], (raw, *amplifier.parameters()), atol=1e-6
    )


@every_reading
@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_refused(reading: str, dtype: torch.dtype) -> None:
    with pytest.raises(TypeError, match="the amplifier needs float32 or better, got torch"):
        AMPLIFIERS[reading](None).before_and_after(torch.zeros(4, dtype=dtype))
