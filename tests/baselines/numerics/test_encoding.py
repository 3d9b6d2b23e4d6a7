"""The encoding against Listing 1 as printed, against mpmath, and in its limits."""

import math

import pytest
import torch
from torch import Tensor, nn

from baselines.numerics.encoding import (
    PHI,
    encode,
    feature_count,
    fourier_features,
    frequency_ladder,
    matched_bands,
)


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


@pytest.mark.parametrize("bands", [1, 4, 10])
def test_features_are_those_of_listing_1_in_its_order(bands: int) -> None:
    x = 2.0 * torch.rand(50, 3, generator=torch.Generator().manual_seed(1)) - 1.0
    ours, printed = fourier_features(x, frequency_ladder(PHI, bands)), Listing1(bands)(x)
    assert ours.shape == printed.shape == (50, feature_count(3, bands))
    # both round f π x, each in its own order: a few ulps of the largest angle, φ^9 π = 239
    torch.testing.assert_close(ours, printed, rtol=0.0, atol=4e-7 * PHI ** (bands - 1) * math.pi)


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_no_bands_are_the_identity(axes: int) -> None:
    x = torch.randn(7, axes, generator=torch.Generator().manual_seed(2))
    assert torch.equal(fourier_features(x, frequency_ladder(2.0, 0)), x)
    assert feature_count(axes, 0) == axes


def test_ladder_is_rounded_once() -> None:
    ladder = frequency_ladder(PHI, 14)
    assert ladder.dtype == torch.get_default_dtype()
    assert ladder.tolist() == [torch.tensor(PHI**k, dtype=torch.float32).item() for k in range(14)]


def test_negative_number_of_bands_is_refused() -> None:
    with pytest.raises(ValueError, match="bands must be >= 0, is -1"):
        frequency_ladder(2.0, -1)


@pytest.mark.parametrize("batch", [(), (5,), (2, 3), (0,)])
def test_any_leading_shape(batch: tuple[int, ...]) -> None:
    x = torch.rand(*batch, 3, generator=torch.Generator().manual_seed(4))
    whole = fourier_features(x, frequency_ladder(2.0, 4))
    assert whole.shape == (*batch, feature_count(3, 4))
    flat = fourier_features(x.reshape(-1, 3), frequency_ladder(2.0, 4))
    assert torch.equal(whole.reshape(flat.shape), flat)


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
