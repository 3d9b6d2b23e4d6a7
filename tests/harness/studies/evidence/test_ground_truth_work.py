"""Slopes and samples from errors whose law is known."""

import math
from typing import Any

import pytest

from harness.records.study import Check
from harness.studies.evidence.work.ground_truth_work import charts, noise_of, sentences, table_of

SPP = [1, 4, 16, 64, 256]
FLOOR = {"lego": 1e-4, "mic": 2e-4}


def rows(scene: str, power: float = 1.0, overhead: float = 0.0) -> list[dict[str, Any]]:
    """Mean square error 0.01 · spp^−power, a millisecond per sample plus the overhead; three renders ± 10 %."""
    return [
        {
            "scene": scene,
            "spp": spp,
            "seconds": [overhead + 1e-3 * spp, overhead + 1e-3 * spp, 9.0],
            "mse": {
                "display": [0.01 * spp**-power * factor for factor in (0.9, 1.0, 1.1)],
                "linear": [0.04 * spp**-power * factor for factor in (0.9, 1.0, 1.1)],
            },
        }
        for spp in SPP
    ]


def test_independent_samples_have_the_slope_of_monte_carlo() -> None:
    noise = noise_of("lego", rows("lego"))
    assert noise.by_samples == pytest.approx(-0.5)
    assert noise.by_seconds == pytest.approx(-0.5)
    # 1 s of overhead: only 256 samples would take longer than 1.2 s, and one point has no slope
    assert noise_of("lego", rows("lego", overhead=1.0)).by_seconds is None
    assert -0.75 < (noise_of("lego", rows("lego", overhead=0.01)).by_seconds or 0.0) <= -0.5
    assert noise.rmse[0] == pytest.approx(0.2)
    assert noise.psnr[0] == pytest.approx(20.0)


def test_an_error_below_that_of_the_reference_is_a_gap() -> None:
    printed = rows("lego")
    printed[-1]["mse"] = {"display": [-1e-9, 0.0, -1e-9], "linear": [-1e-9, 0.0, -1e-9]}
    noise = noise_of("lego", printed)
    assert (noise.rmse[-1], noise.psnr[-1]) == (None, None)
    assert noise.by_samples == pytest.approx(-0.5)
    drawn = list(charts([noise], FLOOR))
    assert all(len(line.x) == len(line.y) for line in drawn)
    assert table_of([noise], FLOOR).rows[0][-1] is None


@pytest.mark.parametrize(("power", "holds"), [(1.0, True), (1.5, True), (0.6, False), (0.0, False)])
def test_noise_that_falls_too_slowly_is_caught(power: float, holds: bool) -> None:
    noises = [noise_of("lego", rows("lego")), noise_of("mic", rows("mic", power))]
    (check,) = (finding for finding in sentences(noises, "") if isinstance(finding, Check))
    assert check.holds == holds
    assert check.value == pytest.approx(max(-0.5, -power / 2))


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_an_error_that_is_not_finite_is_refused(bad: float) -> None:
    """It would pass for one below the reference's."""
    printed = rows("lego")
    printed[2]["mse"]["linear"][1] = bad
    with pytest.raises(ValueError, match="lego with 16 samples per pixel: an error is not finite"):
        noise_of("lego", printed)
