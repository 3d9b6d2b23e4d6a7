"""Progress, learning rate, checkpoints."""

import pytest

from harness.plan.schedule import Budget, Decay, checkpoint_fractions, learning_rate


@pytest.mark.parametrize(
    ("budget", "step", "seconds", "core_seconds", "expected"),
    [
        (Budget(200, None), 0, 0.0, 0.0, 0.0),
        (Budget(200, None), 50, 1e9, 0.0, 0.25),
        (Budget(200, None), 200, 0.0, 0.0, 1.0),
        (Budget(None, 8.0), 10**9, 2.0, 0.0, 0.25),
        (Budget(None, 8.0), 1, 9.0, 0.0, 1.125),
        (Budget(200, 8.0), 100, 2.0, 0.0, 0.5),
        (Budget(200, 8.0), 20, 6.0, 0.0, 0.75),
        (Budget(None, None, 4.0), 10**9, 1e9, 1.0, 0.25),
        (Budget(200, 8.0, 4.0), 20, 2.0, 3.0, 0.75),
    ],
)
def test_progress_is_the_share_of_what_ends_first(
    budget: Budget, step: int, seconds: float, core_seconds: float, expected: float
) -> None:
    assert budget.progress(step, seconds, core_seconds) == expected


@pytest.mark.parametrize(
    ("decay", "expected"),
    [
        ("exponential", [1e-2, 10**-2.5, 1e-3, 10**-3.5, 1e-4]),
        ("linear", [1e-2, 7.525e-3, 5.05e-3, 2.575e-3, 1e-4]),
    ],
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
