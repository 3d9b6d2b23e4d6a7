"""The family of the headline: its members, and that sign and interval never contradict each other."""

import numpy as np
import pytest

from harness.records.cells import CellRecord, Comparison
from harness.verdicts.comparisons import compare
from harness.verdicts.statistics import LEVEL, critical, scenes_like_these
from tests.harness.cells import cell, checkpoint, with_core_seconds

METHODS = ["nerf", "nerf_matched", "qnerf"]


def run(scores: np.ndarray, cores: bool = True) -> list[CellRecord]:
    """Return cells with scores [methods, scenes, seeds], which train equally fast."""
    cells = [
        cell(str(scene), method, seed, [checkpoint(10, 5.0, 18.0), checkpoint(100, 10.0, float(value))])
        for method, table in zip(METHODS, scores, strict=True)
        for scene, row in enumerate(table)
        for seed, value in enumerate(row)
    ]
    return [with_core_seconds(one, 1.0) for one in cells] if cores else cells


def drawn(shift: float, scale: float = 0.1, seed: int = 0) -> np.ndarray:
    scores = 25 + np.random.default_rng(seed).normal(0, scale, (3, 8, 3))
    scores[2] += shift
    return scores


def headline(cells: list[CellRecord]) -> list[Comparison]:
    return [row for row in compare(cells, METHODS) if (row.scene, row.metric) == ("all", "psnr")]


def test_the_family_is_every_pair_at_equal_steps_and_equal_core_seconds() -> None:
    families = {(row.budget, row.family) for row in headline(run(drawn(0.1)))}
    assert families == {("steps", 6), ("core_seconds", 6), ("seconds", 1)}
    assert {row.family for row in headline(run(drawn(0.1), cores=False))} == {6}, "seconds, where no others are counted"


def test_signs_are_holms_and_sizes_bonferronis() -> None:
    """Four of six members are almost certain; Holm tests the other two at 2.5 % each, Bonferroni at 0.8 %."""
    scores = drawn(2.0)
    difference = np.random.default_rng(1).normal(0.0, 0.1, 8)
    difference = (difference - difference.mean()) / difference.std(ddof=1)
    error = 1 / 8**0.5
    wanted = (critical(7.0, 2) + critical(7.0, 6)) / 2 * error
    scores[1] = scores[0] + (difference + wanted)[:, None] * 0.1
    rows = {(row.method, row.against, row.budget): row for row in headline(run(scores))}
    row = rows["nerf_matched", "nerf", "steps"]
    like = row.scenes_like_these
    table = {str(scene): scores[1, scene] - scores[0, scene] for scene in range(8)}
    alone = scenes_like_these(table, 6)
    assert alone.simultaneous[0] < 0, "Bonferroni leaves the sign open"
    assert like.p_adjusted == pytest.approx(2 * like.p)
    assert (like.verdict.sign, like.simultaneous) == ("above 0", (0.0, pytest.approx(alone.simultaneous[1])))
    assert (row.verdict, row.simultaneous) == (like.verdict, like.simultaneous), "the row repeats it"


@pytest.mark.parametrize("seed", range(20))
def test_sign_and_interval_never_contradict_each_other(seed: int) -> None:
    shift, scale = np.random.default_rng(seed).uniform((0.0, 0.02), (0.4, 0.4))
    for row in headline(run(drawn(shift, scale, seed))):
        for known in (row.on_these_scenes, row.scenes_like_these):
            low, high = known.simultaneous
            sign = {"above 0": low >= 0, "below 0": high <= 0, "open": low <= 0 <= high}
            assert sign[known.verdict.sign]
            assert (known.verdict.sign == "open") == (known.p_adjusted > LEVEL)
            if known.verdict.size == "matters":
                assert known.verdict.sign != "open"
