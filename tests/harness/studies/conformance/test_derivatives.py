"""Differences over a ladder of steps against known derivatives."""

import math

import pytest
import torch

from harness.studies.conformance.derivatives import BARS, DOUBLE, SINGLE, Ladder, difference

E1 = torch.tensor([1.0, 0.0])


@pytest.mark.parametrize("ladder", [DOUBLE, SINGLE])
def test_the_bar_holds_the_error_of_a_smooth_function(ladder: Ladder) -> None:
    parameter = torch.tensor([0.7, -0.2], dtype=ladder.dtype)
    eps = torch.finfo(ladder.dtype).eps
    value, bar = difference(lambda: torch.exp(parameter).sum(), parameter, E1.to(ladder.dtype), ladder.steps, 4 * eps)
    assert abs(value - math.exp(0.7)) <= BARS * bar
    assert bar < 1e4 * eps**0.5
    assert parameter.tolist() == torch.tensor([0.7, -0.2], dtype=ladder.dtype).tolist()


def test_a_step_function_is_not_resolved() -> None:
    parameter = torch.tensor([0.0, 1.0], dtype=torch.float64)
    value, bar = difference(lambda: (parameter[0] > 0).double(), parameter, E1.double(), DOUBLE.steps, 1e-16)
    assert bar > 0.4 * abs(value) > 0.0


def test_rounding_widens_the_bar() -> None:
    parameter = torch.tensor([0.7, 0.1], dtype=torch.float64)
    bars = [
        difference(lambda: torch.sin(parameter).sum(), parameter, E1.double(), DOUBLE.steps, error).bar
        for error in (1e-16, 1e-10)
    ]
    assert bars[1] > 100 * bars[0]
