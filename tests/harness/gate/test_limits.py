"""Limits: false alarms and power by simulation, and what must never pass."""

import math
from dataclasses import replace

import numpy as np
import pytest

from harness.gate.catalog import FALSE_ALARM, SPEED_MARGIN, Gate, gates
from harness.gate.limits import SIMULATED, Limit, exact_limit, excess_of, figure_of, limit_from
from harness.gate.outcome import Sample, judged, line_of
from harness.statistics import POWER

MEAN = Gate("training.lego.nerf.psnr", "training", "psnr", "dB", "mean", 2)
NULL = Gate("fairness.a_a.psnr", "fairness", "A/A", "dB", "null", 2)
LARGEST = Gate("images.lego.largest", "images", "largest", "σ", "largest", 16)
SLOWER = Gate("speed.train.nerf", "speed", "a step", "×", "slower")
COUNT = Gate("fairness.batches", "fairness", "batches", "", "none_differs")
EASY = 5
"""A family so small that a simulation sees its alarms."""


def alarms(gate: Gate, measured: np.ndarray, new: np.ndarray) -> float:
    """Share of repetitions in which a limit made of a row of `measured` does not hold for the same row of `new`."""
    found = []
    for row, fresh in zip(measured, new, strict=True):
        figure = figure_of(gate, fresh.tolist())
        assert figure is not None
        found.append(excess_of(figure, limit_from(gate, row.tolist(), EASY)) > 0)
    return float(np.mean(found))


def test_a_gate_alarms_as_often_as_it_says_where_nothing_changed() -> None:
    generator = np.random.default_rng(1)
    measured, new = generator.normal(25, 0.2, (8000, 12)), generator.normal(25, 0.2, (8000, 2))
    level = FALSE_ALARM / EASY
    error = math.sqrt(level / 8000)
    assert alarms(MEAN, measured, new) == pytest.approx(level, abs=4 * error)


def test_an_a_a_gate_alarms_as_often_as_it_says() -> None:
    generator = np.random.default_rng(2)
    measured = generator.normal(25, 0.2, (8000, 12))
    difference = generator.normal(0, 0.2, (8000, 2, 2)).mean(axis=2)
    # one figure: the comparer has averaged the seeds
    figures = (difference[:, 0] - difference[:, 1])[:, None]
    level = FALSE_ALARM / EASY
    assert alarms(NULL, measured, figures) == pytest.approx(level, abs=4 * math.sqrt(level / 8000))


@pytest.mark.parametrize("tail", ["gumbel", "normal"])
def test_the_largest_alarms_no_more_often_than_it_says(tail: str) -> None:
    generator = np.random.default_rng(3)
    shape = (1500, 160 + 16)
    logs = generator.gumbel(1.7, 0.1, shape) if tail == "gumbel" else generator.normal(1.7, 0.12, shape)
    values = np.exp(logs)
    assert alarms(LARGEST, values[:, :160], values[:, 160:]) <= 2 * FALSE_ALARM / EASY


@pytest.mark.parametrize("many", [3, 8, 12])
@pytest.mark.parametrize("gate", [MEAN, NULL, SLOWER])
def test_a_change_of_the_stated_size_is_found_in_80_percent(gate: Gate, many: int) -> None:
    """The size that limits state whose sample has the true spread; the limits vary with their own samples."""
    generator = np.random.default_rng(4)
    exact = np.linspace(-1, 1, many)
    exact = 3 + 0.2 * exact / exact.std(ddof=1)
    size = limit_from(gate, (np.exp(exact) if gate is SLOWER else exact).tolist(), 80).detects
    assert size is not None
    found = []
    for _ in range(4000):
        values = generator.normal(3, 0.2, many)
        limit = limit_from(gate, (np.exp(values) if gate is SLOWER else values).tolist(), 80)
        change = math.log(size) if gate is SLOWER else size
        fresh = generator.normal(3 + change, 0.2, gate.new)
        if gate is NULL:
            fresh -= generator.normal(3, 0.2, gate.new)
        figure = figure_of(gate, (np.exp(fresh) if gate is SLOWER else fresh).tolist())
        assert figure is not None
        found.append(excess_of(figure, limit) > 0)
    assert np.mean(found) == pytest.approx(POWER, abs=4 * math.sqrt(POWER * (1 - POWER) / 4000))


def test_a_slower_step_is_found_beyond_the_declared_margin_alone() -> None:
    generator = np.random.default_rng(5)
    limit = limit_from(SLOWER, np.exp(generator.normal(0.7, 0.03, 8)).tolist(), 66)
    assert limit.low is None, "faster is no failure"
    assert limit.high is not None
    assert limit.centre is not None
    assert SPEED_MARGIN < limit.high / limit.centre < 2.2
    assert limit.detects is not None
    assert excess_of(limit.centre * limit.detects, limit) > 0


def test_every_gate_counts_in_the_correction() -> None:
    values = [25.0, 25.1, 24.8, 25.3]
    few, many = limit_from(MEAN, values, 10), limit_from(MEAN, values, 100)
    assert few.high is not None
    assert many.high is not None
    assert many.high > few.high
    assert len(gates()) == len({gate.name for gate in gates()}) > 50


def test_exact_limits() -> None:
    level = FALSE_ALARM / 66
    assert exact_limit(COUNT, level).high == 0
    calls = exact_limit(replace(COUNT, rule="false_calls"), level)
    assert calls.high is not None
    assert 0.05 < calls.high < 0.1
    found = exact_limit(replace(COUNT, rule="found"), level)
    assert found.low is not None
    assert found.high is not None
    assert 0.7 < found.low < POWER < found.high < 0.9
    assert SIMULATED >= 1000


@pytest.mark.parametrize("values", [[math.nan, 1.0, 2.0], [math.inf, 1.0, 2.0], [1.0, 2.0], []])
def test_limits_are_made_of_all_that_was_measured_or_not_at_all(values: list[float]) -> None:
    with pytest.raises(ValueError, match=r"three or more finite"):
        limit_from(MEAN, values, 66)


def test_a_ratio_that_is_none_makes_no_limit() -> None:
    with pytest.raises(ValueError, match="above 0"):
        limit_from(SLOWER, [0.0, 1.0, 2.0], 66)


@pytest.mark.parametrize("values", [[math.nan, 25.0], [None, 25.0], [math.inf, 25.0], []])
@pytest.mark.parametrize("gate", [MEAN, LARGEST, COUNT])
def test_what_is_no_number_never_passes(gate: Gate, values: list[float | None]) -> None:
    limit = Limit(None, 1e300) if gate is not COUNT else Limit(None, 0.0)
    outcome = judged(gate, Sample(values, "seed 3 diverged"), limit, "")
    assert (outcome.status, outcome.figure, outcome.why) == ("fail", None, "seed 3 diverged")
    assert "no figure" in line_of(outcome)


def test_a_gate_that_was_not_measured_or_has_no_limit_fails() -> None:
    assert judged(MEAN, None, Limit(0, 50), "").status == "fail"
    lacking = judged(MEAN, Sample([25.0, 25.0]), None, "there is no limit for it; renew")
    assert lacking.status == "fail"
    assert lacking.figure == 25.0
    assert "there is no limit for it; renew" in line_of(lacking)


@pytest.mark.parametrize(("figure", "excess"), [(24.0, 0.5), (26.5, 0.5), (24.5, None), (26.0, None), (25.0, None)])
def test_beyond_either_limit_is_a_failure_and_says_by_how_much(figure: float, excess: float | None) -> None:
    outcome = judged(replace(MEAN, new=1), Sample([figure]), Limit(24.5, 26.0), "")
    assert outcome.status == ("pass" if excess is None else "fail")
    assert outcome.excess == (None if excess is None else pytest.approx(excess))
    line = line_of(outcome)
    assert f"{figure:.4g} dB" in line
    assert "24.5 … 26 dB" in line
    assert ("excess 0.5 dB" in line) == (excess is not None)
