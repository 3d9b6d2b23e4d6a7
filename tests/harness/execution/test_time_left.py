"""What is said of the time that is left."""

import pytest

from harness.execution.progress import SPREAD, TimeLeft, span


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (0.2, 0.3, "0 to 0.5 s"),
        (12.0, 24.0, "12 to 25 s"),
        (70.0, 140.0, "1 to 2.5 min"),
        (13 * 60.0, 24 * 60.0, "13 to 25 min"),
        (3 * 3600.0, 3.1 * 3600.0, "about 3 h"),
        (2 * 86400.0, 5 * 86400.0, "2 to 5 d"),
    ],
)
def test_a_span_is_no_more_exact_than_it_is_known(low: float, high: float, words: str) -> None:
    assert span(low, high) == words


def left(seconds: float) -> tuple[float, float]:
    return pytest.approx((SPREAD[0] * seconds, SPREAD[1] * seconds))


def test_the_pace_counts_from_the_first_report_of_each_piece(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter((900.0, 930.0, 960.0, 960.0, 990.0, 990.0))
    monkeypatch.setattr("time.monotonic", lambda: next(times))
    clock = TimeLeft(2.0)
    assert clock.after(0.1, "a") is None
    assert clock.after(0.2, "a") is None, "too little to tell"
    assert clock.after(0.4, "a") == left(60.0 / 0.3 * 1.6)
    assert clock.after(0.5, "b") == left(60.0 / 0.3 * 1.1), "what an interrupted piece brings took no time"
    assert clock.after(1.0, "a") == left(90.0 / 0.9 * 0.5)
    assert clock.after(1.0, "b") is None, "all is done"
    assert clock.share == 1.0
