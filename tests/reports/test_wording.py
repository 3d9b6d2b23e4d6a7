"""Numbers as words."""

import math

import pytest

from reports import wording


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(1.005, 1, "1.0"), (-0.001, 2, "0.00"), (-1.5, 1, "−1.5"), (None, 2, "–"), (math.nan, 2, "–"), (math.inf, 2, "–")],
)
def test_number(value, digits, text):
    assert wording.number(value, digits) == text


def test_signed_puts_plus_before_what_is_above_zero_alone():
    assert [wording.signed(v) for v in (0.5, -0.5, 0.0, 0.001, None)] == ["+0.50", "−0.50", "0.00", "0.00", "–"]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (493056.0, "493\u202f056"),
        (12.345, "12.3"),
        (0.0312, "0.0312"),
        (-2.5e-7, "−2.50·10⁻⁷"),
        (1e-6, "10⁻⁶"),
    ],
)
def test_significant_keeps_three_digits(value, text):
    assert wording.significant(value) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.84, "0.8 s"), (41.6, "42 s"), (200.0, "3 min 20 s"), (7500.0, "2 h 05 min"), (None, "–"), (math.nan, "–")],
)
def test_duration(seconds, text):
    assert wording.duration(seconds) == text


def test_interval_and_lists():
    assert wording.interval((-0.1, 0.25)) == "[−0.10, +0.25]"
    assert wording.interval(None) == ""
    assert wording.listed(["a", "b", "c"]) == "a, b and c"
    assert [wording.counted(many, "seed") for many in (1, 3)] == ["1 seed", "3 seeds"]
