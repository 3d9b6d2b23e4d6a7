"""Progress, learning rate, checkpoints, and a generator for each purpose."""

import pytest
import torch

from harness.plan.schedule import Budget, Decay, checkpoint_fractions, learning_rate
from harness.plan.seeds import generator_for


@pytest.mark.parametrize(
    ("budget", "step", "seconds", "core_seconds", "expected"),
    [
        (Budget(200, None), 0, 0.0, 0.0, 0.0), (Budget(200, None), 50, 1e9, 0.0, 0.25),
        (Budget(200, None), 200, 0.0, 0.0, 1.0), (Budget(None, 8.0), 10**9, 2.0, 0.0, 0.25),
        (Budget(None, 8.0), 1, 9.0, 0.0, 1.125), (Budget(200, 8.0), 100, 2.0, 0.0, 0.5),
        (Budget(200, 8.0), 20, 6.0, 0.0, 0.75), (Budget(None, None, 4.0), 10**9, 1e9, 1.0, 0.25),
        (Budget(200, 8.0, 4.0), 20, 2.0, 3.0, 0.75),
    ],
)  # fmt: skip
def test_progress_is_the_share_of_what_ends_first(
    budget: Budget, step: int, seconds: float, core_seconds: float, expected: float
) -> None:
    assert budget.progress(step, seconds, core_seconds) == expected


@pytest.mark.parametrize(
    ("decay", "expected"),
    [("exponential", [1e-2, 10**-2.5, 1e-3, 10**-3.5, 1e-4]), ("linear", [1e-2, 7.525e-3, 5.05e-3, 2.575e-3, 1e-4])],
)
def test_the_learning_rate_falls_by_equal_factors_or_equal_steps(decay: Decay, expected: list[float]) -> None:
    assert [learning_rate(i / 4, 1000, 1e-2, 1e-4, 0, decay) for i in range(5)] == pytest.approx(expected)
    assert learning_rate(1.3, 1000, 1e-2, 1e-4, 0, decay) == pytest.approx(1e-4)


def test_the_warm_up_is_linear_and_never_zero() -> None:
    rates = [learning_rate(0.0, step, 1.0, 0.1, 3, "exponential") for step in range(6)]
    assert rates == pytest.approx([0.25, 0.5, 0.75, 1.0, 1.0, 1.0])
    assert learning_rate(0.0, 0, 1.0, 0.1, 0, "exponential") == 1.0


def test_checkpoints_are_even_in_log_time_and_end_with_the_budget() -> None:
    assert checkpoint_fractions(5, 0.01) == pytest.approx([0.01, 10**-1.5, 0.1, 10**-0.5, 1.0])
    assert checkpoint_fractions(1, 0.3) == [1.0]


# a generator for each purpose


def numbers(*purpose: int | str) -> list[float]:
    return torch.rand(4, generator=generator_for(*purpose)).tolist()


def test_a_purpose_has_its_numbers_in_every_order_and_leaves_the_global_generator_alone() -> None:
    first, before = numbers(0, 5, "batch"), torch.get_rng_state()
    numbers(0, 6, "batch")
    assert torch.equal(torch.get_rng_state(), before)
    torch.manual_seed(1)
    assert numbers(0, 5, "batch") == first


def test_different_purposes_have_different_numbers() -> None:
    purposes = [(0, 1, "batch"), (0, 1, "jitter"), (1, 0, "batch"), (0, 11, "batch"), (0, 1, "grid"), (0, "batch")]
    purposes += [(1, 23), (12, 3)]
    assert len({tuple(numbers(*purpose)) for purpose in purposes}) == len(purposes)


def test_a_purpose_has_the_same_seed_in_every_process_and_version() -> None:
    assert generator_for(3, 14, "batch").initial_seed() == 2002049673550745313


def test_seeds_of_neighbouring_purposes_are_unrelated() -> None:
    draws = torch.stack([torch.rand(50, generator=generator_for(0, step, "jitter")) for step in range(60)])
    correlation = torch.corrcoef(draws) - torch.eye(60)
    assert float(correlation.abs().max()) < 0.7
    assert abs(float(draws.mean()) - 0.5) < 0.02
