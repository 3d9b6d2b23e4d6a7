"""What is said of many calls, against sums by hand."""

import pytest

from harness.studies.serving.serving_context import latency, timed


def test_seconds_are_those_between_two_looks_at_the_clock() -> None:
    times = iter([10.0, 12.5])
    assert timed(lambda: "picture", lambda: next(times)) == ("picture", 2.5)


def test_median_spread_and_ratio_against_opposite_quartiles() -> None:
    rendering = [40.0, 10.0, 20.0, 30.0, 50.0]
    found = latency("lego", "nerf", "level 0", [0.1, 0.2, 0.3, 0.4, 0.5], rendering)
    assert (found.seconds, found.calls) == (pytest.approx(0.3), 5)
    assert found.spread == (pytest.approx(0.12), pytest.approx(0.48))
    assert found.ratio == pytest.approx(100.0)
    assert found.ratio_spread == (pytest.approx(20.0 / 0.4), pytest.approx(40.0 / 0.2))


def test_rendering_itself_has_no_ratio() -> None:
    found = latency("lego", "nerf", "render", [1.0, 3.0])
    assert (found.seconds, found.ratio, found.ratio_spread) == (2.0, None, None)


@pytest.mark.parametrize(
    ("seconds", "said"), [([], "no call"), ([0.1, 0.0], "too coarse"), ([0.1, -1.0], "ran backwards")]
)
def test_what_no_clock_gives_is_refused(seconds: list[float], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        latency("lego", "nerf", "level 0", seconds)
    with pytest.raises(ValueError, match=said):
        latency("lego", "nerf", "level 0", [1.0], seconds)
