"""Where a method breaks: the stated criterion, on records written by hand."""

from pathlib import Path

import numpy as np
import pytest

from harness.records.cells import CellRecord
from harness.studies.stability.whole_scenes.ladder_cases import (
    LEAST_RUNGS,
    RungScore,
    _outcome,
    _row,
    rungs_climbed,
    score_of,
    share_of_views,
    worst,
)
from harness.studies.stability.whole_scenes.scene_truth import SceneRun, mse_over_tests, share_of_looks
from scenes.catalog.ladders.ladders import LADDERS
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.view_set import Split, ViewSet
from tests.harness.cells import cell, checkpoint, diverged
from tests.harness.studies.stability.made_up import pictured, run_of

FREQUENCY = LADDERS["frequency"]


def views_of(rgba: np.ndarray) -> ViewSet:
    test = Split(("test/r_0",), np.eye(4)[None], ImageStack.of([rgba.astype(np.float32)]))
    none = Split((), np.zeros((0, 4, 4)), ImageStack((8, 8, 4)))
    box = np.array([[-1.0] * 3, [1.0] * 3])
    return ViewSet(Path(), "x", "x", 8, 8, 0.7, 2.0, 6.0, box, none, none, test)


def half_covered() -> np.ndarray:
    """Upper half white background, lower half covered by stripes of 0.2 and 0.8: variance 0.09 within."""
    rgba = np.zeros((8, 8, 4))
    rgba[4:, ::2, :3], rgba[4:, 1::2, :3] = 0.2, 0.8
    rgba[4:, :, 3] = 1.0
    return rgba


def shown_as(tmp_path: Path, stripes: float, psnr: float) -> tuple[SceneRun, CellRecord]:
    """A cell that shows the stripes with that contrast about their mean, and the background as it is."""
    image = np.ones((8, 8, 3))
    image[4:, ::2], image[4:, 1::2] = 0.5 - 0.3 * stripes, 0.5 + 0.3 * stripes
    record = cell("frequency_1", "nerf", 0, [checkpoint(1, 1.0, psnr)], pictures=pictured(tmp_path, image))
    return run_of(tmp_path, record), record


@pytest.mark.parametrize(("contrast", "share"), [(1.0, 1.0), (0.0, 0.0), (0.5, 0.75)])
def test_looks_are_judged_within_the_silhouette(tmp_path: Path, contrast: float, share: float) -> None:
    run, record = shown_as(tmp_path, contrast, 20.0)
    assert share_of_looks(run, record, views_of(half_covered())) == pytest.approx(share, abs=0.01)


def test_shape_is_judged_over_whole_views() -> None:
    variance = (0.5 * 1.0 + 0.25 * 0.04 + 0.25 * 0.64) - 0.75**2
    mse = mse_over_tests(cell("frequency_1", "nerf", 0, []))
    assert mse == pytest.approx(0.01)
    assert share_of_views(0.01, views_of(half_covered())) == pytest.approx(1 - 0.01 / variance)


def test_who_gets_the_silhouette_alone_is_broken(tmp_path: Path) -> None:
    run, record = shown_as(tmp_path, 0.0, 13.0)
    assert score_of(run, record, views_of(half_covered()), looks=True).broken.startswith("explains")
    whole = score_of(run, record, views_of(half_covered()), looks=False)
    assert whole.broken == "", "over whole views the silhouette is most of what there is"


def test_a_cell_without_scores_is_broken_and_says_why() -> None:
    record = diverged("frequency_1", "nerf", 0)
    score = score_of(run_of(Path(), record), record, views_of(half_covered()), looks=True)
    assert (score.share, score.broken) == (None, "diverged: not finite at step 7: loss")


def test_below_the_copy_of_the_nearest_view_is_said_and_no_break(tmp_path: Path) -> None:
    run, record = shown_as(tmp_path, 1.0, 30.0)
    record.scores["psnr_floor"] = 35.0
    score = score_of(run, record, views_of(half_covered()), looks=True)
    assert score.broken == ""
    assert score.note == "30.0 dB, a copy of the nearest training view 35.0 dB"


WHOLE, BROKEN = RungScore(0.9, ""), RungScore(0.1, "explains 10%")


def test_of_several_seeds_the_worst_counts() -> None:
    none = RungScore(None, "diverged: x")
    assert worst([WHOLE, BROKEN]) is BROKEN
    assert worst([BROKEN, none, WHOLE]) is none


def test_the_first_broken_rung_is_the_one_that_counts() -> None:
    climbed = [WHOLE, WHOLE, BROKEN, WHOLE, BROKEN]
    assert rungs_climbed(climbed) == 2
    assert rungs_climbed([WHOLE] * 5) == 5
    assert _row(FREQUENCY, "nerf", climbed)[2] == "3: 11 cycles around the ball"
    assert _row(FREQUENCY, "nerf", [WHOLE] * 5)[2] == "none"


@pytest.mark.parametrize(
    ("method", "first", "status", "broke"),
    [("nerf", WHOLE, "pass", False), ("nerf", BROKEN, "fail", True), ("qnerf", BROKEN, "fail", False)],
)
def test_what_is_ours_must_climb_the_first_rung(method: str, first: RungScore, status: str, broke: bool) -> None:
    run = run_of(Path(), cell("frequency_1", method, 0, []))
    outcome = _outcome(FREQUENCY, run, method, [first, *[BROKEN] * 4])
    assert (outcome.status, outcome.is_broken) == (status, broke)


def test_a_method_that_is_not_available_is_no_failure() -> None:
    missing = cell("frequency_1", "nerf", 0, [], status="not_available", reason="no LLVM")
    outcome = _outcome(FREQUENCY, run_of(Path(), missing), "nerf", [RungScore(None, "not_available: no LLVM")] * 5)
    assert (outcome.status, outcome.why, outcome.is_broken) == ("not_available", "no LLVM", False)


def test_the_control_must_be_climbed_whole() -> None:
    assert set(LEAST_RUNGS) == set(LADDERS)
    scale, run = LADDERS["scale"], run_of(Path(), cell("scale_1", "nerf", 0, []))
    assert _outcome(scale, run, "nerf", [WHOLE] * 5).status == "pass"
    assert _outcome(scale, run, "nerf", [*[WHOLE] * 4, BROKEN]).is_broken
