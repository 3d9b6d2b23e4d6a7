"""Limits of images: false alarms and power by simulation, and values that never pass."""

import math

import numpy as np
import pytest

from harness.gate import limits
from harness.gate.gates import Gate
from harness.gate.limits import NONE_DIFFERS, Limit, judge, limit_from
from harness.studies.framework import line_of
from harness.verdicts.statistics import POWER

MEAN = Gate("images.lego.bias", "brightness", "%", 2)
LARGEST = Gate("images.lego.largest", "largest", "σ", 16)
COUNT = Gate("fairness.batches", "batches")
EASY = 0.002
"""A level at which a simulation has alarms."""


def alarms(gate: Gate, measured: np.ndarray, new: np.ndarray) -> float:
    """Return the share of rows for which a limit made from `measured` does not hold for `new`."""
    pairs = zip(measured, new, strict=True)
    checks = [judge(gate, fresh.tolist(), limit_from(gate, row.tolist())) for row, fresh in pairs]
    return float(np.mean([check.is_broken for check in checks]))


def test_gates_alarm_as_often_as_they_say_where_nothing_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "LEVEL", EASY)
    generator = np.random.default_rng(3)
    measured, new = generator.normal(25, 0.2, (8000, 12)), generator.normal(25, 0.2, (8000, 2))
    assert alarms(MEAN, measured, new) == pytest.approx(EASY, abs=4 * math.sqrt(EASY / 8000))
    shape = (1500, 160 + 16)
    for logs in (generator.gumbel(1.7, 0.1, shape), generator.normal(1.7, 0.12, shape)):
        values = np.exp(logs)
        assert alarms(LARGEST, values[:, :160], values[:, 160:]) <= 2 * EASY


@pytest.mark.parametrize("many", [3, 8, 12])
def test_a_change_of_the_stated_size_is_found_in_80_percent(many: int) -> None:
    """The stated size is that of a sample with the true spread; the limits vary with their samples."""
    generator = np.random.default_rng(4)
    exact = np.linspace(-1, 1, many)
    size = limit_from(MEAN, (3 + 0.2 * exact / exact.std(ddof=1)).tolist()).detects
    measured = generator.normal(3, 0.2, (4000, many))
    fresh = generator.normal(3 + size, 0.2, (4000, MEAN.new))
    assert alarms(MEAN, measured, fresh) == pytest.approx(POWER, abs=4 * math.sqrt(POWER * (1 - POWER) / 4000))


@pytest.mark.parametrize("values", [[math.nan, 1.0, 2.0], [math.inf, 1.0, 2.0], [1.0, 2.0], []])
def test_limits_are_made_of_all_that_was_measured_or_not_at_all(values: list[float]) -> None:
    with pytest.raises(ValueError, match=r"three or more finite"):
        limit_from(MEAN, values)


@pytest.mark.parametrize("values", [[math.nan, 25.0], [None, 25.0], [math.inf, 25.0], []])
@pytest.mark.parametrize("gate", [MEAN, LARGEST, COUNT])
def test_what_is_no_number_never_passes(gate: Gate, values: list[float | None]) -> None:
    limit = NONE_DIFFERS if gate is COUNT else Limit(None, 1e300)
    check = judge(gate, values, limit, "seed 3 diverged")
    assert (check.is_broken, check.value, check.why) == (True, None, "seed 3 diverged")
    assert "no figure" in line_of(check)


def test_a_gate_without_a_limit_fails_with_its_figure() -> None:
    check = judge(MEAN, [25.0, 25.0], "there is no limit for it; renew")
    assert (check.is_broken, check.value, check.why) == (True, 25.0, "there is no limit for it; renew")
    with pytest.raises(ValueError, match="neither a lower nor an upper limit"):
        Limit(None, None)


def test_the_figure_is_the_mean_or_the_largest() -> None:
    assert judge(MEAN, [1.0, 3.0], Limit(0, 50)).value == 2.0
    assert judge(LARGEST, [1.0, 3.0], Limit(0, 50)).value == 3.0
