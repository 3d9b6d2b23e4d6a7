"""The running mean of weights: its closed form, what is seen inside and outside, and the same bits after a pause."""

import math

import pytest
import torch
from torch import Tensor, nn

from baselines.numerics.weight_average import WeightAverage


def after(power: float, course: Tensor) -> Tensor:
    """The mean after the weights went through `course`."""
    weight = nn.Parameter(torch.full_like(course[0], 7.0))
    average = WeightAverage([weight], power)
    for values in course:
        weight.data.copy_(values)
        average.observe()
    return average.means[0]


def course(steps: int) -> Tensor:
    return torch.randn((steps, 5), generator=torch.Generator().manual_seed(3), dtype=torch.float64)


@pytest.mark.parametrize("power", [0, 3, 12])
def test_integer_powers_are_sums_with_weights_in_closed_form(power: int) -> None:
    # power 0 is the plain mean; the first weights are forgotten
    # of w_t = 1 − (1 − 1/t)^(p + 1), step s keeps (s^(p + 1) − (s − 1)^(p + 1)) / t^(p + 1)
    steps = 25
    s = torch.arange(1, steps + 1, dtype=torch.float64)
    kept = (s ** (power + 1) - (s - 1) ** (power + 1)) / steps ** (power + 1)
    assert float(kept.sum()) == pytest.approx(1.0)
    assert after(power, course(steps)) == pytest.approx((kept[:, None] * course(steps)).sum(dim=0))


def test_the_mean_is_seen_inside_alone_also_if_an_error_ends_it() -> None:
    weight = nn.Parameter(torch.tensor([1.0]))
    average = WeightAverage([weight], 0.0)
    average.observe()
    weight.data.fill_(3.0)
    average.observe()

    def look() -> None:
        with average.shown():
            assert weight.detach() == 2.0
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        look()
    assert weight.detach() == 3.0
    average.adopt()
    assert weight.detach() == 2.0
    weight.data.fill_(5.0)
    assert float(average.means[0]) == 2.0, "adopted weights are a copy"


def test_a_pause_changes_no_bit() -> None:
    values = course(30).float()
    whole = after(12.0, values)
    weight = nn.Parameter(torch.zeros(5))
    first, second = WeightAverage([weight], 12.0), WeightAverage([nn.Parameter(torch.zeros(5))], 12.0)
    for row in values[:13]:
        weight.data.copy_(row)
        first.observe()
    second.restore(first.tensors())
    for row in values[13:]:
        second.weights[0].data.copy_(row)
        second.observe()
    assert torch.equal(second.means[0], whole)
    with pytest.raises(RuntimeError, match="mean 0 of"):
        WeightAverage([nn.Parameter(torch.zeros(4))], 12.0).restore(first.tensors())
    assert not math.isnan(float(whole.sum()))
