"""Ceilings against independent renders, from simulated noise; and the process that renders, played by a script."""

import numpy as np
import pytest

from harness.studies.evidence.ceilings import TOLERANCE_DB, Agreement, agreement, judge
from tests.harness.studies.evidence.planted import checks

VIEWS = 15
TRUE_MSE = 1e-4


def estimates(seed: int, factor: float = 1.0) -> list[float]:
    """The noise that 15 views state: 40.0 dB, with errors of about 0.1 dB."""
    return list(factor * TRUE_MSE * np.exp(np.random.default_rng(seed).normal(0.0, 0.02, VIEWS)))


def agreements(scenes: int = 8, factor: float = 1.0) -> list[Agreement]:
    return [
        agreement(f"scene{k}", estimates(3 * k), estimates(3 * k + 1, factor), estimates(3 * k + 2))
        for k in range(scenes)
    ]


def test_a_known_variance_is_a_known_ceiling() -> None:
    lego = agreement("lego", [1e-4, 1e-3], [1e-4, 1e-4], [1e-2, 1e-3])
    assert (lego.stated, lego.again, lego.halves, lego.views) == pytest.approx((35.0, 40.0, 25.0, 2))
    assert lego.difference == pytest.approx(-5.0)
    assert lego.error == pytest.approx(5.0)  # the differences are 0 and −10
    assert lego.excess == pytest.approx((5.0 - TOLERANCE_DB) / 5.0)


@pytest.mark.parametrize("factor", [1.0, 2.0, 0.5, 1.05])
def test_a_wrong_factor_is_caught(factor: float) -> None:
    """5 % is 0.21 dB, and the eight scenes together show it to 0.01 dB."""
    mean, worst, _ = checks(judge(agreements(factor=factor)))
    assert mean.value == pytest.approx(10 * np.log10(factor), abs=0.05)
    assert mean.holds == worst.holds == (factor == 1.0)
    if factor == 1.0:
        assert worst.value == 0.0
        assert str(next(iter(judge(agreements())))).startswith("8 of 8 ceilings lie within 0.1 dB")
    odd = [*agreements(7), agreement("odd", estimates(1), estimates(2, 1.15), estimates(3))]
    assert [check.holds for check in checks(judge(odd))[:2]] == [True, False], "one wrong scene does not move the mean"


def test_a_scene_whose_views_differ_too_much_is_not_called_wrong() -> None:
    wide = agreement("mic", [1e-4 * 1.5, 1e-4 / 1.1, 1e-4], [1e-4, 1e-4, 1e-4], [1e-4] * 3)
    assert abs(wide.difference) > TOLERANCE_DB
    _, worst, error = checks(judge([wide, *agreements(3)]))
    assert worst.holds
    # … but the large error is seen
    assert not error.holds
    assert error.value == wide.error
    assert error.why.startswith("mic; with a larger one, 0.1 dB could not be detected")


def test_standard_errors_that_resolve_the_tolerance_hold_and_the_widest_pass_is_said() -> None:
    """Two logarithms of ±2 % each: 10 / ln 10 · 0.02 · √2 / √15 = 0.032 dB, and with all eight scenes' quantile."""
    _, worst, error = checks(judge(agreements()))
    assert error.holds
    assert error.value == pytest.approx(0.032, rel=0.5)
    widest = TOLERANCE_DB + (worst.high or 0.0) * (error.value or 0.0)
    assert f"{widest:.2f} dB where they are largest" in worst.why


def test_the_rows_are_what_the_renderer_prints() -> None:
    """The names that are read here are fields there."""
    from dataclasses import fields

    from scenes.rendering.noise_study import Rerender

    assert {"stored", "again", "halves", "spp", "variant", "scene"} <= {field.name for field in fields(Rerender)}
