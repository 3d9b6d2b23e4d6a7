"""What is said of the time that is left."""

import pytest

from harness.execution.progress import SPREAD, TimeLeft, in_turn, span


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (0.2, 0.3, "0 to 0.5 s"),
        (12.0, 24.0, "12 to 25 s"),
        (40.0, 70.0, "40 to 70 s"),
        (70.0, 140.0, "1 to 2.5 min"),
        (13 * 60.0, 24 * 60.0, "13 to 25 min"),
        (3600.0, 7100.0, "1 to 2 h"),
        (3 * 3600.0, 3.1 * 3600.0, "about 3 h"),
        (2 * 86400.0, 5 * 86400.0, "2 to 5 d"),
    ],
)
def test_a_span_is_no_more_exact_than_it_is_known(low: float, high: float, words: str) -> None:
    assert span(low, high) == words


def test_nothing_is_said_before_something_is_finished(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter((0.0, 15.0, 30.0))
    monkeypatch.setattr("time.monotonic", lambda: next(times))
    left = TimeLeft()
    assert left.words(0.0, enough=True) == ""
    assert left.words(0.01, enough=False) == ""
    assert left.words(0.0, enough=True) == "", "time went by and nothing was done"


def test_what_came_before_the_first_report_is_no_part_of_the_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter((900.0, 960.0, 970.0))
    monkeypatch.setattr("time.monotonic", lambda: next(times))
    left = TimeLeft()
    left.words(0.1, enough=False)
    assert left.words(0.4, enough=True) == f"{span(120.0 * SPREAD[0], 120.0 * SPREAD[1])} left"
    assert left.words(1.0, enough=True) == ""


def test_what_was_done_before_is_no_part_of_the_pace(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter((0.0, 60.0, 60.0))
    monkeypatch.setattr("time.monotonic", lambda: next(times))
    left = TimeLeft()
    left.words(0.0, enough=False, kept=0.0)
    assert left.words(0.5, enough=True, kept=0.4) == f"{span(300.0 * SPREAD[0], 300.0 * SPREAD[1])} left"
    at_least = left.words(0.5, enough=True, kept=0.0, at_least=500.0)
    assert at_least == f"{span(500.0 * SPREAD[0], 500.0 * SPREAD[1])} left"


def test_pieces_that_cannot_be_divided_leave_workers_idle() -> None:
    assert in_turn([], 2, 0, 10.0) == 0.0
    assert in_turn([9.0], 2, 0, 10.0) == 9.0
    assert in_turn([9.0, 1.0], 2, 1, 10.0) == 11.0
    assert in_turn([5.0], 2, 2, 10.0) == 15.0, "one has nothing to do already"
    assert in_turn([5.0, 5.0], 2, 3, 10.0) == 25.0
