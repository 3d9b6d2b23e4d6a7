"""The text next to a mean: changes, a robust estimate that disagrees, and outliers."""

import numpy as np
import pytest
from msgspec.structs import replace

from harness.records.cells import Comparison, Flagged, Robust
from harness.records.verdict import OPEN
from harness.verdicts.changes import change_of
from reports.data.outcome import change_in_words, doubts, robust_differs, robust_in_words

ROW = Comparison("all", "qnerf", "nerf", "psnr", "steps", 0.15, None, OPEN, None, 24, 0, None, 6, None, None)


@pytest.mark.parametrize(
    ("robust", "differs"),
    [
        (None, False),
        (Robust(0.3, (0.1, 0.5)), False),  # 0.15 dB apart, on the same side
        (Robust(0.36, (0.1, 0.5)), True),  # more than 0.2 dB apart
        (Robust(-0.01, None), True),  # on the other side
        (Robust(0.0, None), False),
    ],
)
def test_a_robust_estimate_is_stated_if_it_disagrees(robust: Robust | None, differs: bool) -> None:
    row = replace(ROW, robust=robust)
    assert robust_differs(row) == differs
    assert bool(robust_in_words(row)) == bool(list(doubts(row))) == differs
    assert not robust_differs(replace(row, difference=None))


def test_one_bad_cell_and_the_robust_estimate_are_stated() -> None:
    flagged = [Flagged("chair", 1, -2.7, 0.31)]
    row = replace(ROW, difference=-0.1, robust=Robust(0.3, (0.21, 0.4)), flagged=flagged)
    assert list(doubts(row)) == [
        "The mean of qnerf − nerf at equal steps, −0.10 dB, is not that of most cells: robust: +0.30 [+0.21, +0.40].",
        "Off all others of qnerf − nerf at equal steps, whose median is +0.31: chair, seed 1 (−2.70).",
    ]
    assert list(doubts(None)) == []


def test_a_change_is_stated_with_its_interval_and_its_scenes() -> None:
    moved = np.array([-0.3, -0.4, -0.5, 0.1])
    tables = [{str(k): np.full(3, value) for k, value in enumerate(side)} for side in (np.zeros(4), moved)]
    change = change_of("qnerf", "nerf", *tables, paired=True)
    assert change_in_words(change) == (
        "qnerf − nerf changes by −0.28 dB [−0.69, +0.14], on 3 of 4 scenes in that direction: sign and size open"
    )
