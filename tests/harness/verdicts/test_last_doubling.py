"""The gain of the last doubling is exact if PSNR is linear in the logarithm of steps."""

import math

import pytest
from msgspec.structs import replace

from harness.records.cells import CellRecord
from harness.verdicts.last_doubling import gain_of_last_doubling, in_words, last_doublings
from tests.harness.cells import cell, checkpoint, diverged


def rising(slope: float, scene: str = "lego", method: str = "nerf", seed: int = 0) -> CellRecord:
    """Return a cell that gains `slope` dB per doubling, without a checkpoint at half of its steps."""
    curve = [checkpoint(step, 0.01 * step, 20.0 + slope * math.log2(step)) for step in (10, 70, 300, 1000)]
    return cell(scene, method, seed, curve)


@pytest.mark.parametrize("slope", [-0.5, 0.0, 0.9])
def test_a_line_in_log_steps_gains_its_slope(slope: float) -> None:
    assert gain_of_last_doubling(rising(slope)) == pytest.approx(slope, abs=1e-12)


def test_only_what_lies_between_half_and_end_counts() -> None:
    curve = [checkpoint(1, 1.0, 5.0), checkpoint(50, 2.0, 20.0), checkpoint(100, 3.0, 20.75)]
    assert gain_of_last_doubling(cell("lego", "nerf", 0, curve)) == 0.75


def test_what_is_not_known_is_none() -> None:
    late = cell("lego", "nerf", 0, [checkpoint(51, 1.0, 20.0), checkpoint(100, 2.0, 21.0)])
    assert gain_of_last_doubling(late) is None, "no checkpoint at or below half"
    at_half = cell("lego", "nerf", 0, [checkpoint(50, 1.0, 20.0), checkpoint(100, 2.0, 21.0)])
    assert gain_of_last_doubling(at_half) == 1.0
    identical = cell("lego", "nerf", 0, [checkpoint(50, 1.0, 20.0), checkpoint(100, 2.0, None)])
    assert gain_of_last_doubling(identical) is None, "an end without a score"
    assert gain_of_last_doubling(cell("lego", "nerf", 0, [])) is None
    assert gain_of_last_doubling(diverged("lego", "nerf", 0)) is None
    empty = replace(rising(1.0), warnings=["empty collapse: mean test opacity 0.001"])
    assert gain_of_last_doubling(empty) is None


def test_means_are_over_scenes_of_the_means_over_seeds_with_t_over_scenes() -> None:
    slopes = {("a", 0): 1.0, ("a", 1): 2.0, ("b", 0): 0.5}
    cells = [rising(slope, scene, "nerf", seed) for (scene, seed), slope in slopes.items()]
    nerf, qnerf = last_doublings([*cells, diverged("b", "nerf", 1), diverged("a", "qnerf", 0)], ["nerf", "qnerf"])
    # scenes 1.5 and 0.5: mean 1, standard error 0.5, t of one degree of freedom 12.7062
    assert (nerf.method, nerf.cells) == ("nerf", 3)
    assert nerf.gain == pytest.approx(1.0)
    assert nerf.interval == pytest.approx((1 - 0.5 * 12.7062, 1 + 0.5 * 12.7062), abs=1e-4)
    assert (qnerf.gain, qnerf.interval, qnerf.cells) == (None, None, 0)
    assert in_words(nerf) == "nerf: +1.00 dB [−5.35, +7.35] in its last doubling of steps; still rising"
    assert in_words(qnerf) == "qnerf: what its last doubling of steps brought is not known"
    (one,) = last_doublings([rising(0.29)], ["nerf"])
    assert in_words(one) == "nerf: +0.29 dB in its last doubling of steps"
