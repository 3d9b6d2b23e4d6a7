"""The refusal of invalid rays, with the names in its errors."""

import math

import pytest
import torch

from baselines.numerics.checks import BadDensity, BadInterval, require_density, require_interval, require_rising


@pytest.mark.parametrize(("near", "far"), [(6.0, 2.0), (2.0, math.inf), (math.nan, 2.0), (-math.inf, 1.0)])
def test_what_is_no_interval(near: float, far: float) -> None:
    with pytest.raises(BadInterval, match="every ray: runs from") as caught:
        require_interval(near, far)
    assert caught.value.ray is None


def test_equal_distances_tiny_densities_and_rays_without_samples_are_accepted() -> None:
    require_rising(torch.tensor([[0.0, 0.0, 1.0], [1.0, 2.0, 2.0]]))
    require_density(torch.tensor([[0.0, -0.0, 1e-45, 3e38]]))
    for shape in ((0, 4), (3, 1), (3, 0)):
        require_rising(torch.zeros(shape))
        require_density(torch.zeros(shape))


@pytest.mark.parametrize(
    ("row", "place"),
    [
        ([0.0, 2.0, 1.0], 2),
        ([0.0, math.nan, 1.0], 1),
        ([0.0, 1.0, math.inf], 2),
        ([0.0, math.inf, math.inf], 1),
        ([-math.inf, 0.0, 1.0], 0),
    ],
)
def test_the_first_distance_that_does_not_rise_is_named(row: list[float], place: int) -> None:
    t = torch.tensor([[0.0, 1.0, 2.0], row, [5.0, 4.0, 3.0]])
    with pytest.raises(BadInterval, match=f"^ray 1: distance {place} is"):
        require_rising(t)


@pytest.mark.parametrize("wrong", [math.nan, -math.inf, -1e-30])
def test_the_density_that_is_none_is_named(wrong: float) -> None:
    sigma = torch.ones(4, 5, requires_grad=True)
    with torch.no_grad():
        sigma[2, 3] = wrong
    with pytest.raises(BadDensity, match="of sample 3 on ray 2: must be finite") as caught:
        require_density(sigma)
    assert (caught.value.ray, caught.value.sample) == (2, 3)
    assert caught.value.value == pytest.approx(wrong, nan_ok=True)
    assert caught.value.among(torch.tensor([7, 8, 9])).ray == 9
