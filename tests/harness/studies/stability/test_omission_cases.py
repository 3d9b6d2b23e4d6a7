"""N1: what verdict makes what outcome. Nothing is trained here."""

import pytest

from harness.studies.choices.omissions import Omission, Verdict
from harness.studies.stability.whole_scenes.ladder_cases import _control, _worst
from scenes.modelling.needs import PARTS

NAME = "empty_space"


def omission(
    verdict: Verdict,
    difference: float | None,
    interval: tuple[float, float] | None = (-0.01, 0.01),
    scene: str = "tiny",
    pairs: int = 3,
) -> Omission:
    return Omission(scene, "nerf", NAME, 1.0, "training", difference, interval, pairs, 3 - pairs, verdict)


def test_a_cost_within_its_bound_passes() -> None:
    outcome = _worst([omission("within its bound", 0.01), omission("within its bound", -0.02, scene="materials")])
    assert (outcome.status, outcome.value, outcome.limit) == ("pass", 0.02, PARTS[NAME].bound)
    assert "materials" in outcome.why
    assert "2.0 s saved" in outcome.why


def test_what_costs_more_fails_whatever_else_there_is() -> None:
    outcome = _worst([omission("inconclusive", -9.0), omission("costs more", -0.5, scene="materials")])
    assert (outcome.status, outcome.value, outcome.is_broken) == ("fail", 0.5, True)
    assert "costs more on materials" in outcome.why


@pytest.mark.parametrize("difference", [-0.02, -0.4])
def test_what_is_inconclusive_never_passes_and_says_its_interval(difference: float) -> None:
    outcome = _worst(
        [omission("within its bound", -0.01), omission("inconclusive", difference, (-0.6, 0.1), "materials")]
    )
    assert (outcome.status, outcome.value) == ("inconclusive", -difference)
    assert "materials: inconclusive: interval [-0.1, +0.6] dB over 3 seeds" in outcome.why


def test_no_measurement_is_not_available_and_says_why() -> None:
    outcome = _worst([omission("within its bound", 0.0), omission("inconclusive", None, None, "materials", pairs=0)])
    assert (outcome.status, outcome.value) == ("not_available", None)
    assert "materials: no measurement: 3 of 3 pairs" in outcome.why
    ended = _worst([omission("costs more", None, None, pairs=0)])
    assert (ended.status, ended.value) == ("fail", None)


def test_a_control_must_cost_and_be_measured() -> None:
    assert _control(omission("costs more", -20.0)).status == "pass"
    assert _control(omission("within its bound", 0.0)).is_broken
    assert _control(omission("inconclusive", None, None, pairs=0)).status == "not_available"
