"""Ray against box: brute force, and the cases in which the slab method divides by zero."""

import math

import pytest
import torch

from baselines.numerics.bounds import ray_box

NEAR, FAR = 0.5, 8.0
LOWER, UPPER = torch.tensor([-1.0, -0.5, -0.25]), torch.tensor([1.0, 0.75, 0.5])


def meet(o: list[float], d: list[float], near: float = NEAR, far: float = FAR) -> tuple[float, float, bool]:
    entry, leave, hit = ray_box(torch.tensor([o]), torch.tensor([d]), LOWER, UPPER, near, far)
    return entry.item(), leave.item(), hit.item()


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


def test_no_rays() -> None:
    entry, leave, hit = ray_box(torch.zeros(0, 3), torch.zeros(0, 3), LOWER, UPPER, NEAR, FAR)
    assert entry.shape == leave.shape == hit.shape == (0,)
