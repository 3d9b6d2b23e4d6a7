"""The two amplifiers against the printed code and in their limits."""

import pytest
import torch
from torch import Tensor, nn

from baselines.amplifiers import AMPLIFIERS, Equation4Amplifier, Listing2Amplifier, NoAmplifier
from baselines.numerics.amplifier import amplify_about_mean, amplify_listing2, softplus_density
from baselines.numerics.encoding import PHI


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


def raw_densities(scale: float = 3.0) -> Tensor:
    return scale * torch.randn(500, generator=torch.Generator().manual_seed(5))


def scalar(value: float, dtype: torch.dtype = torch.float32) -> Tensor:
    return torch.tensor(value, dtype=dtype)


@pytest.mark.parametrize("alpha", [1.0 / PHI, 0.0, -1.0, 1.0, 10.0])
@pytest.mark.parametrize("beta", [1.0, 0.5, 3.0])
def test_listing_2_is_the_printed_code_with_its_gradients(alpha: float, beta: float) -> None:
    printed, ours = Listing2(), Listing2Amplifier()
    raws = [raw_densities().requires_grad_() for _ in range(2)]
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


def test_equation_4_is_the_identity_at_one_over_phi() -> None:
    sigma = torch.rand(1000, generator=torch.Generator().manual_seed(6))
    amplified = amplify_about_mean(sigma, sigma.mean(), scalar(1.0 / PHI))
    assert float((amplified - sigma).abs().max()) <= 1.2e-7
    exact = amplify_about_mean(sigma.double(), sigma.double().mean(), scalar(1.0 / PHI, torch.float64))
    assert float((exact - sigma.double()).abs().max()) <= 1e-15


@pytest.mark.parametrize("alpha", [-1.0, 0.0, 0.3, 1.0, 4.0])
def test_equation_4_point_by_point(alpha: float) -> None:
    sigma = torch.rand(40, dtype=torch.float64, generator=torch.Generator().manual_seed(7)) * 30.0
    mean = sum(sigma.tolist()) / 40
    expected = [mean + alpha * (value - mean) * PHI for value in sigma.tolist()]
    amplified = amplify_about_mean(sigma, sigma.mean(), scalar(alpha, torch.float64))
    torch.testing.assert_close(amplified, torch.tensor(expected, dtype=torch.float64))
    # the mean stays where it is, whatever alpha; the spread grows by alpha phi
    torch.testing.assert_close(amplified.mean(), sigma.mean())
    torch.testing.assert_close(amplified.std(), abs(alpha) * PHI * sigma.std())


def test_equation_4_of_a_negative_density_is_empty_space() -> None:
    amplifier = Equation4Amplifier()
    with torch.no_grad():
        amplifier.alpha.fill_(5.0)
    before, after = amplifier.before_and_after(raw_densities())
    assert (before >= 0).all()
    assert (after >= 0).all()
    assert (after == 0).any()


def test_listing_2_stays_within_0_and_1_and_boosts_above_the_threshold_alone() -> None:
    normalised = torch.tensor([0.0, 0.2, 0.5, 0.6, 1.0])
    mean, alpha = scalar(0.3), scalar(1.0 / PHI)
    boosted = amplify_listing2(normalised, mean, alpha, scalar(1.5))
    torch.testing.assert_close(boosted, torch.tensor([0.0, 0.2, 0.5, 0.9, 1.0]), rtol=0.0, atol=2e-7)
    moved = amplify_listing2(normalised, mean, alpha, scalar(1.5), threshold=0.55)
    torch.testing.assert_close(moved, boosted)


@pytest.mark.parametrize("make", [NoAmplifier, Listing2Amplifier, Equation4Amplifier])
def test_bounded_says_whether_density_stays_within_0_and_1(make: type[nn.Module]) -> None:
    amplifier = make(None)
    assert amplifier.bounded == bool((amplifier.before_and_after(raw_densities(scale=30.0))[1] <= 1.0).all())
    assert amplifier.before_and_after(torch.zeros(0))[1].shape == (0,), "no points are no points"


def test_softplus_density_in_closed_form() -> None:
    raw = torch.linspace(-30.0, 30.0, 601, dtype=torch.float64)
    sigma = softplus_density(raw, -4.4)
    torch.testing.assert_close(sigma, torch.log1p(torch.exp(raw - 4.4)))
    assert (sigma > 0).all()


@pytest.mark.parametrize("name", AMPLIFIERS)
@pytest.mark.parametrize("start", [1e-6, 0.012, 0.3, 0.9, 12.5, 1e3])
def test_a_fresh_field_has_its_start(name: str, start: float) -> None:
    """Where the raw output is 0, density is the start, whatever the reading; a bounded one cannot start above 1."""
    if start >= 1.0 and AMPLIFIERS[name](None).bounded:
        with pytest.raises(ValueError, match="a sigmoid lies between 0 and 1"):
            AMPLIFIERS[name](start)
        return
    before, after = AMPLIFIERS[name](start).before_and_after(torch.zeros(3))
    torch.testing.assert_close(after, torch.full((3,), start), rtol=1e-5, atol=0.0)
    torch.testing.assert_close(before, after)


@pytest.mark.parametrize("name", AMPLIFIERS)
@pytest.mark.parametrize("start", [0.0, -1.0, float("nan")])
def test_a_start_that_is_no_density_is_refused(name: str, start: float) -> None:
    with pytest.raises(ValueError, match="a start of"):
        AMPLIFIERS[name](start)


@pytest.mark.parametrize(("name", "printed"), [("none", 0.6931472), ("listing2", 0.5), ("equation4", 0.6931472)])
def test_as_printed_nothing_is_shifted(name: str, printed: float) -> None:
    assert AMPLIFIERS[name](None).before_and_after(torch.zeros(1))[1].item() == pytest.approx(printed)


SIXTY_DECADES = [0.0, 1e-45, 1e-30, 1e-10, 1e-4, 1.0, 1e4, 1e10, 1e30]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("largest", SIXTY_DECADES)
@pytest.mark.parametrize("make", [NoAmplifier, Listing2Amplifier, Equation4Amplifier])
def test_sixty_decades_of_raw_density_are_finite_with_finite_gradients(
    make: type[nn.Module], largest: float, sign: float
) -> None:
    amplifier = make(None)
    raw = torch.tensor([value for value in SIXTY_DECADES if value <= largest] + [largest] * 500)
    raw = (sign * raw).requires_grad_()
    before, after = amplifier.before_and_after(raw)
    after.sum().backward()
    assert torch.isfinite(before).all()
    assert torch.isfinite(after).all()
    assert (after >= 0).all()
    assert torch.isfinite(raw.grad).all()  # type: ignore[arg-type]
    assert all(torch.isfinite(weight.grad) for weight in amplifier.parameters())


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_refused(dtype: torch.dtype) -> None:
    raw = torch.zeros(4, dtype=dtype)
    for make in (NoAmplifier, Listing2Amplifier, Equation4Amplifier):
        with pytest.raises(TypeError, match="the amplifier needs float32 or better, got torch"):
            make(None).before_and_after(raw)
