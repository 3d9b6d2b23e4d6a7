"""The encoding against Listing 1 as printed; `encode` against float64 and mpmath in every band, against
`fourier_features` in every bit; both in their limits.
"""

import math

import pytest
import torch
from torch import Tensor, nn
from torch.autograd import forward_ad

from baselines.numerics.encoding import (
    PHI,
    encode,
    feature_count,
    fourier_features,
    frequency_ladder,
    matched_bands,
)
from harness.studies.stability.rays.encoding_cases import true_waves


class Listing1(nn.Module):
    """Listing 1 of the paper, word for word (np.pi is math.pi)."""

    def __init__(self, num_freqs: int = 10) -> None:
        super().__init__()
        freq_bands = PHI ** torch.linspace(0, num_freqs - 1, num_freqs)
        self.register_buffer("freq_bands", freq_bands)

    def forward(self, x: Tensor) -> Tensor:
        out = [x]
        for freq in self.freq_bands:
            out.append(torch.sin(freq * math.pi * x))
            out.append(torch.cos(freq * math.pi * x))
        return torch.cat(out, dim=-1)


@pytest.mark.parametrize("bands", [0, 1, 4, 10])
def test_features_are_those_of_listing_1_in_its_order(bands: int) -> None:
    x = 2.0 * torch.rand(50, 3, generator=torch.Generator().manual_seed(1)) - 1.0
    ours, printed = fourier_features(x, frequency_ladder(PHI, bands)), Listing1(bands)(x)
    assert ours.shape == printed.shape == (50, feature_count(3, bands))
    # both round f π x, each in its own order: a few ulps of the largest angle, φ^9 π = 239
    torch.testing.assert_close(ours, printed, rtol=0.0, atol=4e-7 * PHI ** (bands - 1) * math.pi)


def test_ladder_is_rounded_once() -> None:
    ladder = frequency_ladder(PHI, 14)
    assert ladder.dtype == torch.get_default_dtype()
    assert ladder.tolist() == [torch.tensor(PHI**k, dtype=torch.float32).item() for k in range(14)]


@pytest.mark.parametrize(
    ("base", "bands", "said"),
    [(2.0, -1, "must be >= 0, is -1"), (2.0, 129, "give at most 128"), (PHI, 2000, "give at most 185")],
)
def test_a_number_of_bands_that_has_no_ladder_is_refused(base: float, bands: int, said: str) -> None:
    assert frequency_ladder(2.0, 128, torch.float32)[-1] == 2.0**127
    with pytest.raises(ValueError, match=said):
        frequency_ladder(base, bands, torch.float32)


@pytest.mark.parametrize("bands", range(1, 25))
@pytest.mark.parametrize("base", [PHI, 1.2, 2.0, 3.0])
def test_matched_bands_reach_as_far_and_no_further(base: float, bands: int) -> None:
    count = matched_bands(base, bands)
    top = base ** (bands - 1)
    assert 2.0 ** (count - 1) <= top * (1 + 1e-12) < 2.0**count * (1 + 2e-12)


SIXTY_DECADES = [0.0, 1e-45, 1e-30, 1e-10, 1e-4, 1.0, 1e4, 1e10, 1e30]


@pytest.mark.parametrize("base", [2.0, PHI])
@pytest.mark.parametrize("x", [*SIXTY_DECADES, *(-x for x in SIXTY_DECADES)])
def test_sixty_decades_of_positions_are_finite_with_finite_gradients(base: float, x: float) -> None:
    positions = torch.tensor([[x]], requires_grad=True)
    fourier_features(positions, frequency_ladder(base, 10)).sum().backward()
    assert torch.isfinite(positions.grad).all()  # type: ignore[arg-type]
    for features in (fourier_features(positions, frequency_ladder(base, 10)), encode(positions.detach(), base, 10)):
        assert torch.isfinite(features).all()
        assert (features[:, 1:].abs() <= 1.0 + 1e-5).all()


# `encode`

MOST_BANDS = {2.0: 20, PHI: 12}
SINE_ERROR = {
    2.0: [2.15e-7 * 2**k for k in range(20)],
    PHI: [2.2e-7, 3.5e-7, 5.4e-7, 9.0e-7, 1.5e-6, 3.0e-6, 2.4e-6, 7.3e-6, 8.0e-6, 1.15e-5, 1.85e-5, 5.7e-5],
}
"""Worst error of a float32 sine or cosine of f_k π x at |x| <= 1: that of half of all floats in 0.25 … 1, and 3 %."""
WORST_POINTS = [0.9594049, 0.70799679, 0.82964283, 0.67696291, 0.71384221, 0.99998653, 0.99195886]  # of base 2
WORST_POINTS += [0.97729111, 0.78944975, 0.84408224, 0.88934112, 0.86091918, 0.9966597, 0.829184, 0.97599095]  # φ
WORST_POINTS += [0.84506017, 0.92030418, 0.96976089]
BASES = pytest.mark.parametrize("base", [2.0, PHI], ids=["2", "phi"])


def random_points(count: int, axes: int = 3, dtype: torch.dtype = torch.float32) -> Tensor:
    return 2.0 * torch.rand(count, axes, generator=torch.Generator().manual_seed(1), dtype=dtype) - 1.0


def hard_points() -> Tensor:
    """Zeros, extrema and fixed points of doubling; what is next to 1; tiny and denormal numbers; a grid; a sample."""
    rationals = [torch.arange(-n, n + 1) / n for n in (55, 60, 64, 81)]
    golden = torch.tensor([PHI**-k for k in range(12)])
    tiny = torch.tensor([0.0, -0.0, 1e-30, -1e-30, 1e-38, -1e-40, 1e-45])
    powers = 2.0 ** -torch.arange(24.0)
    worst = torch.tensor(WORST_POINTS)
    points = torch.cat(
        [*rationals, golden, tiny, powers, 1.0 - powers, worst, -worst, torch.linspace(-1.0, 1.0, 20001)]
    )
    return torch.cat([points.unsqueeze(-1), random_points(60000, 1)])


def error_by_band(x: Tensor, base: float, bands: int) -> list[float]:
    """Return the worst error of float32 against float64, which is compared with mpmath below."""
    apart = encode(x, base, bands) - encode(x.double(), base, bands)
    return apart[:, x.shape[1] :].reshape(len(x), bands, -1).abs().amax((0, 2)).tolist()


def exceeding(errors: list[float], bounds: list[float]) -> list[str]:
    return [f"band {k}: {e:.2e} > {b:.2e}" for k, (e, b) in enumerate(zip(errors, bounds, strict=True)) if e > b]


def exact(x: Tensor, base: float, bands: int) -> Tensor:
    """[points, 2 bands] of points on one axis, correct to float64's last bit."""
    return torch.cat([true_waves(x[:, 0], base, band) for band in range(bands)], dim=-1)


@BASES
def test_error_of_every_band_is_within_its_bound(base: float) -> None:
    x, bands, bounds = hard_points(), MOST_BANDS[base], SINE_ERROR[base]
    errors = error_by_band(x, base, bands)
    assert not exceeding(errors, bounds)
    assert errors[-1] >= bounds[-1] / 3, "the bounds no longer describe what float32 does"


@BASES
def test_float64_keeps_float64(base: float) -> None:
    bands = MOST_BANDS[base]
    x = torch.cat([random_points(400, 1, torch.float64), torch.tensor([[1.0], [-0.5], [1 / 3], [1e-300], [1e-30]])])
    features = encode(x, base, bands)
    assert features.dtype == torch.float64
    errors = (features[:, 1:] - exact(x, base, bands)).abs().amax(0).view(bands, 2).amax(1).tolist()
    assert not exceeding(errors, [1.5e-15 * base**k for k in range(bands)])


@BASES
def test_up_to_four_times_outside_the_box_the_error_grows_by_four(base: float) -> None:
    x, bands = 4.0 * hard_points(), 10
    bounds = [5 * bound for bound in SINE_ERROR[base][:bands]]
    assert not exceeding(error_by_band(x, base, bands), bounds)


@BASES
@pytest.mark.parametrize("x", [1e-10, -1e-30, 1e-36])
def test_sine_of_a_tiny_number_keeps_its_relative_precision(base: float, x: float) -> None:
    features = encode(torch.tensor([[x]]), base, 10)[0, 1:].double().view(10, 2)
    angles = math.pi * x * frequency_ladder(base, 10, torch.float64)
    torch.testing.assert_close(features[:, 0], angles, rtol=2e-6, atol=0.0)
    assert (features[:, 1] == 1.0).all()


@BASES
def test_what_is_not_finite_stays_visible(base: float) -> None:
    for x in (math.nan, math.inf, -math.inf):
        assert encode(torch.tensor([[x]]), base, 10)[:, 1:].isnan().all()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("base", [2.0, PHI, 1.65])
@pytest.mark.parametrize("points", [0, 1, 2, 17, 1023, 20001])
@pytest.mark.parametrize(("axes", "bands"), [(3, 0), (3, 1), (1, 2), (2, 7), (3, 10)])
def test_every_bit_is_that_of_the_oracle(dtype: torch.dtype, base: float, points: int, axes: int, bands: int) -> None:
    x = random_points(points, axes, dtype)
    oracle = fourier_features(x, frequency_ladder(base, bands, dtype))
    ours = encode(x, base, bands)
    assert ours.shape == oracle.shape
    assert torch.equal(ours, oracle)


@BASES
def test_a_point_has_its_features_whoever_its_neighbours_are_and_however_it_is_stored(base: float) -> None:
    x = random_points(20001)
    whole = encode(x, base, 10)
    for part in (slice(0, 1), slice(3, 1000), slice(17, 4113), slice(16000, 20001)):
        assert torch.equal(encode(x[part], base, 10), whole[part])
    for same in (x.repeat_interleave(2, dim=0)[::2], x.t().contiguous().t()):
        assert torch.equal(encode(same, base, 10), whole)


@BASES
def test_points_of_a_feature_adjoin_and_nothing_given_is_changed(base: float) -> None:
    x = random_points(50)
    before = x.clone()
    features = encode(x, base, 10)
    assert features.t().is_contiguous()
    features.zero_()
    assert torch.equal(x, before)
    assert encode(x, base, 10).count_nonzero() == features.numel()


@BASES
def test_gradient_where_one_is_wanted_is_that_of_the_oracle(base: float) -> None:
    x = random_points(4, dtype=torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: encode(x, base, 4), (x,))
    with torch.no_grad():
        assert not encode(x, base, 4).requires_grad


@BASES
@pytest.mark.filterwarnings("ignore:.*torch.jit.script.*:FutureWarning")
def test_forward_mode_derivative_is_refused(base: float) -> None:
    x = random_points(4)
    with forward_ad.dual_level(), pytest.raises(NotImplementedError, match="forward AD"):
        encode(forward_ad.make_dual(x, torch.ones_like(x)), base, 4)


def test_inference_mode_leaves_nothing_behind_that_training_cannot_use() -> None:
    x = random_points(8)
    with torch.inference_mode():
        encode(x, PHI, 9)
        encode(x, 2.0, 9)
    for base in (PHI, 2.0):
        weight = torch.ones(3 * 19, 2, requires_grad=True)
        (encode(x, base, 9) @ weight).sum().backward()
        assert weight.grad is not None


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_half_precision_is_refused(dtype: torch.dtype) -> None:
    with pytest.raises(TypeError, match="needs float32 or float64"):
        encode(torch.zeros(2, 3, dtype=dtype), 2.0, 3)
    with pytest.raises(TypeError, match="float32 or better"):
        fourier_features(torch.zeros(2, 3, dtype=dtype), frequency_ladder(2.0, 3))
