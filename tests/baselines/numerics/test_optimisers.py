"""SOAP against the paper's algorithm written down plainly; every optimiser: no NaN, and the same bits after a pause.
The running mean of weights: its closed form, and what an error leaves.
"""

import math

import pytest
import torch
from torch import Tensor, nn

from baselines.numerics.optimisers import LARGEST_SIDE, OPTIMISERS, OptimiserSettings, optimiser_of
from baselines.numerics.soap import LEAST, Soap
from baselines.numerics.weight_average import WeightAverage

BETAS, EVERY = (0.9, 0.99), 3


def weights(*shapes: tuple[int, ...], dtype: torch.dtype = torch.float64) -> list[nn.Parameter]:
    source = torch.Generator().manual_seed(4)
    return [nn.Parameter(torch.randn(shape, generator=source, dtype=dtype)) for shape in shapes]


def gradient(like: Tensor, step: int) -> Tensor:
    source = torch.Generator().manual_seed(100 * step + like.numel())
    scale = torch.logspace(0, -3, like.shape[-1] if like.ndim else 1, dtype=like.dtype)
    return torch.randn(like.shape, generator=source, dtype=like.dtype) * (scale if like.ndim else 1.0)


def least(factor: Tensor) -> Tensor:
    return LEAST * torch.diagonal(factor).mean()


def axes(side: int) -> Tensor:
    return torch.diag(torch.linspace(1.0, 0.0, side, dtype=torch.float64))


def plain_soap(weight: Tensor, steps: int, rate: float) -> Tensor:
    """Algorithm 3 of the paper with the authors' order of things, for one matrix, with no thought for speed."""
    w = weight.detach().clone()
    m, n = w.shape
    left, right, first, second = (torch.zeros(shape).double() for shape in ((m, m), (n, n), (m, n), (m, n)))
    u = v = torch.zeros(0)
    for t in range(steps):
        g = gradient(w, t)
        left = BETAS[1] * left + (1 - BETAS[1]) * g @ g.T
        right = BETAS[1] * right + (1 - BETAS[1]) * g.T @ g
        if t == 0:
            u, v = (torch.linalg.eigh(f + least(f) * axes(len(f))).eigenvectors.flip(1) for f in (left, right))
            continue
        turned = u.T @ g @ v
        first = BETAS[0] * first + (1 - BETAS[0]) * turned
        second = BETAS[1] * second + (1 - BETAS[1]) * turned**2
        size = rate * math.sqrt(1 - BETAS[1] ** t) / (1 - BETAS[0] ** t)
        w = w - size * u @ (first / (second.sqrt() + 1e-8)) @ v.T
        if t % EVERY == 0:
            whole = u @ first @ v.T
            for axis, factor in ((0, left), (1, right)):
                basis = u if axis == 0 else v
                order = torch.argsort(torch.diagonal(basis.T @ factor @ basis), descending=True)
                second = second.index_select(axis, order)
                new = torch.linalg.qr((factor + least(factor) * torch.eye(len(factor))) @ basis[:, order]).Q
                u, v = (new, v) if axis == 0 else (u, new)
            first = u.T @ whole @ v
    return w


def take(optimiser: object, some: list[nn.Parameter], steps: range, rate: float = 0.01) -> None:
    for step in steps:
        for weight in some:
            weight.grad = gradient(weight.detach(), step)
        optimiser.step(rate)  # type: ignore[attr-defined]


def test_stacked_soap_is_the_plain_one_for_each_matrix() -> None:
    some = weights((5, 7), (5, 7), (7, 5), (1, 7), (4, 4))
    expected = [plain_soap(weight, 20, 0.01) for weight in some]
    take(Soap(some, BETAS, EVERY), some, range(20))
    for weight, plain in zip(some, expected, strict=True):
        torch.testing.assert_close(weight.detach(), plain, rtol=1e-7, atol=1e-7)


def test_what_is_no_matrix_gets_the_steps_of_adam_after_the_first() -> None:
    some, others = weights((6,), (), (2, 3, 4)), weights((6,), (), (2, 3, 4))
    soap, adam = Soap(some, BETAS, EVERY), optimiser_of(others, OptimiserSettings("adam", BETAS))
    take(soap, some, range(1))
    take(soap, some, range(1, 30))
    take(adam, others, range(1, 30))
    for mine, theirs in zip(some, others, strict=True):
        torch.testing.assert_close(mine.detach(), theirs.detach(), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", list(OPTIMISERS))
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_zero_constant_and_rank_one_gradients_leave_finite_weights(name: str, dtype: torch.dtype) -> None:
    some, first = (weights((6, 9), (6, 9), (1, 9), (9,), (), dtype=dtype) for _ in range(2))
    optimiser = optimiser_of(some, OptimiserSettings(name, BETAS, EVERY))  # type: ignore[arg-type]
    for step in range(40):
        for weight in some:
            kind = step // 10
            weight.grad = (
                torch.zeros_like(weight) if kind in (0, 2) else torch.full_like(weight, 10.0 ** (2 - 4 * kind))
            )
        optimiser.step(0.01)
        assert all(bool(torch.isfinite(weight).all()) for weight in some)
        assert step >= 10 or all(map(torch.equal, some, first)), "nothing moves while every gradient is zero"


@pytest.mark.parametrize("name", list(OPTIMISERS))
def test_one_that_was_restored_takes_the_same_steps_to_the_bit(name: str) -> None:
    settings = OptimiserSettings(name, BETAS, EVERY)  # type: ignore[arg-type]
    shapes = (6, 9), (9, 6), (6, 9), (9,), (), (3, 4, 4, 2)
    whole, parted = weights(*shapes, dtype=torch.float32), weights(*shapes, dtype=torch.float32)
    take(optimiser_of(whole, settings), whole, range(17))
    first = optimiser_of(parted, settings)
    take(first, parted, range(8))
    kept = {key: value.clone() for key, value in first.tensors().items()}
    second = optimiser_of(parted, settings)
    second.restore(kept)
    take(second, parted, range(8, 17))
    assert all(torch.equal(mine, theirs) for mine, theirs in zip(whole, parted, strict=True))


def test_state_of_other_weights_is_refused() -> None:
    kept = Soap(weights((6, 9)), BETAS, EVERY).tensors()
    with pytest.raises((RuntimeError, KeyError)):
        Soap(weights((9, 6)), BETAS, EVERY).restore(kept)
    with pytest.raises(RuntimeError, match="mean 0 of"):
        WeightAverage(weights((4,)), 12.0).restore(WeightAverage(weights((5,)), 12.0).tensors())


@pytest.mark.parametrize("shape", [(LARGEST_SIDE + 1, 2), (3, 4, 4, 2)])
def test_under_soap_tables_of_features_are_trained_by_adam(shape: tuple[int, ...]) -> None:
    """The network is trained as without the tables."""
    mixed, alone, table = weights((4, 5), shape), weights((4, 5)), weights((4, 5), shape)[1:]
    take(optimiser_of(mixed, OptimiserSettings("soap", BETAS, EVERY)), mixed, range(5))
    take(Soap(alone, BETAS, EVERY), alone, range(5))
    take(optimiser_of(table, OptimiserSettings("adam", BETAS)), table, range(5))
    assert torch.equal(mixed[0], alone[0])
    assert torch.equal(mixed[1], table[0])


# the running mean of weights


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


def test_an_error_while_the_mean_is_shown_brings_the_weights_back() -> None:
    weight = nn.Parameter(torch.tensor([1.0]))
    average = WeightAverage([weight], 0.0)
    average.observe()
    weight.data.fill_(3.0)
    average.observe()
    with pytest.raises(ZeroDivisionError), average.shown():
        raise ZeroDivisionError
    assert weight.detach() == 3.0
    average.adopt()
    assert weight.detach() == 2.0
    weight.data.fill_(5.0)
    assert float(average.means[0]) == 2.0, "adopted weights are a copy"
