"""Ray against box: brute force, and the cases in which the slab method divides by zero."""

import math

import pytest
import torch
from torch import Tensor

from baselines.numerics.bounds import ray_box

NEAR, FAR = 0.5, 8.0
LOWER, UPPER = torch.tensor([-1.0, -0.5, -0.25]), torch.tensor([1.0, 0.75, 0.5])


def meet(o: list[float], d: list[float], near: float = NEAR, far: float = FAR) -> tuple[float, float, bool]:
    entry, leave, hit = ray_box(torch.tensor([o]), torch.tensor([d]), LOWER, UPPER, near, far)
    return entry.item(), leave.item(), hit.item()


def brute_force(o: Tensor, d: Tensor, steps: int) -> tuple[float, float] | None:
    """First and last of many points along the ray that lie in the box."""
    t = torch.linspace(NEAR, FAR, steps, dtype=torch.float64)
    x = o.double() + t.unsqueeze(-1) * d.double()
    inside = t[((x >= LOWER.double()) & (x <= UPPER.double())).all(dim=-1)]
    return (float(inside[0]), float(inside[-1])) if len(inside) else None


def random_rays(count: int) -> tuple[Tensor, Tensor]:
    """From outside and inside the box, in random and in axis-parallel directions."""
    generator = torch.Generator().manual_seed(9)
    o = 3.0 * torch.randn(count, 3, generator=generator)
    o[::3] *= 0.1
    d = torch.randn(count, 3, generator=generator) - 0.4 * o
    d[::5] *= torch.tensor([1.0, 0.0, 1.0])
    d[::10] *= torch.tensor([0.0, 0.0, 1.0])
    d[::20] = d[::20].abs() * torch.tensor([-0.0, -0.0, 1.0])
    return o, torch.nn.functional.normalize(d, dim=-1)


def test_agrees_with_many_points_along_the_ray() -> None:
    o, d = random_rays(300)
    entry, leave, hit = ray_box(o, d, LOWER, UPPER, NEAR, FAR)
    step = (FAR - NEAR) / 7500
    hits = 0
    for ray in range(300):
        found = brute_force(o[ray], d[ray], 7501)
        if found is None:
            assert leave[ray] - entry[ray] <= step
            continue
        hits += 1
        assert hit[ray]
        assert found[0] - step <= float(entry[ray]) <= found[0] + 1e-5
        assert found[1] - 1e-5 <= float(leave[ray]) <= found[1] + step
    assert 50 < hits < 280, "the rays should both hit and miss"


def test_ray_through_the_middle() -> None:
    assert meet([0.0, 0.0, 4.0], [0.0, 0.0, -1.0]) == (3.5, 4.25, True)


def test_ray_that_starts_inside_enters_at_near() -> None:
    assert meet([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]) == (0.5, 1.0, True)
    assert meet([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], near=0.0) == (0.0, 1.0, True)


@pytest.mark.parametrize(
    ("o", "d", "why"),
    [
        ([0.0, 0.0, 4.0], [0.0, 0.0, 1.0], "the box lies behind"),
        ([5.0, 5.0, 5.0], [0.0, 0.0, -1.0], "passes beside"),
        ([0.0, 0.0, 20.0], [0.0, 0.0, -1.0], "the box lies beyond far"),
        ([0.8, 0.0, 0.0], [1.0, 0.0, 0.0], "leaves before near"),
        ([-2.0, -0.5, 0.0], [math.sqrt(0.5), -math.sqrt(0.5), 0.0], "points away from it"),
    ],
)
def test_a_miss_has_zero_length(o: list[float], d: list[float], why: str) -> None:
    entry, leave, hit = meet(o, d)
    assert not hit, why
    assert entry == leave
    assert math.isfinite(entry)


def test_near_and_far_cut() -> None:
    assert meet([0.0, 0.0, 4.0], [0.0, 0.0, -1.0], near=3.75, far=4.0) == (3.75, 4.0, True)


def test_no_rays() -> None:
    entry, leave, hit = ray_box(torch.zeros(0, 3), torch.zeros(0, 3), LOWER, UPPER, NEAR, FAR)
    assert entry.shape == leave.shape == hit.shape == (0,)
