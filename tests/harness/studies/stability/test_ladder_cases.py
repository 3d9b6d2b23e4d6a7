"""Where a method breaks: the stated criterion, on records written by hand."""

from pathlib import Path

import numpy as np
import pytest

from harness.records.cells import CellRecord, RunRecord, records_folder
from harness.records.pictures import Render, cell_pictures, half, write_renders
from harness.studies.stability.whole_scenes.ladder_cases import (
    LEAST_RUNGS,
    RungScore,
    _outcome,
    _row,
    rungs_climbed,
    share_of_views,
    standing,
    worst,
)
from harness.studies.stability.whole_scenes.scene_truth import SceneRun, share_of_looks
from scenes.catalog.ladders.ladders import LADDERS
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.view_set import Split, ViewSet
from tests.harness.cells import cell, checkpoint, diverged

FREQUENCY = LADDERS["frequency"]


def views_of(rgba: np.ndarray) -> ViewSet:
    test = Split(("test/r_0",), np.eye(4)[None], ImageStack.of([rgba.astype(np.float32)]))
    none = Split((), np.zeros((0, 4, 4)), ImageStack((8, 8, 4)))
    box = np.array([[-1.0] * 3, [1.0] * 3])
    return ViewSet(Path(), "x", "x", 8, 8, 0.7, 2.0, 6.0, box, none, none, test)


def left_behind(out: Path, *cells: CellRecord) -> SceneRun:
    run = RunRecord("ladder", "", [], {}, [], {}, [0], {}, {}, {}, True, [])
    return SceneRun(out, out, run, {(one.scene, one.method): [one] for one in cells})


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
    picture = half(image)
    path = cell_pictures("frequency_1", "nerf", 0)
    drawn = Render("test/r_0", 1, picture, picture[..., 0], picture[..., 0])
    write_renders(records_folder(tmp_path) / path, [drawn])
    one = cell("frequency_1", "nerf", 0, [checkpoint(1, 1.0, psnr)], pictures=path)
    return left_behind(tmp_path, one), one


@pytest.mark.parametrize(("contrast", "share"), [(1.0, 1.0), (0.0, 0.0), (0.5, 0.75)])
def test_looks_are_judged_within_the_silhouette(tmp_path: Path, contrast: float, share: float) -> None:
    found, one = shown_as(tmp_path, contrast, 20.0)
    assert share_of_looks(found, one, views_of(half_covered())) == pytest.approx(share, abs=0.01)


def test_shape_is_judged_over_whole_views(tmp_path: Path) -> None:
    views = views_of(half_covered())
    variance = (0.5 * 1.0 + 0.25 * 0.04 + 0.25 * 0.64) - 0.75**2
    _, one = shown_as(tmp_path, 0.0, 20.0)
    assert share_of_views(one, views) == pytest.approx(1 - 0.01 / variance)


def test_who_gets_the_silhouette_alone_is_broken(tmp_path: Path) -> None:
    found, one = shown_as(tmp_path, 0.0, 13.0)
    broken = standing(found, one, views_of(half_covered()), looks=True)
    assert broken.broken.startswith("explains")
    whole = standing(found, one, views_of(half_covered()), looks=False)
    assert whole.broken == "", "over whole views the silhouette is most of what there is"


def test_a_cell_without_scores_is_broken_and_says_why() -> None:
    one = diverged("frequency_1", "nerf", 0)
    said = standing(left_behind(Path(), one), one, views_of(half_covered()), looks=True)
    assert (said.share, said.broken) == (None, "diverged: not finite at step 7: loss")


def test_below_the_copy_of_the_nearest_view_is_said_and_no_break(tmp_path: Path) -> None:
    found, one = shown_as(tmp_path, 1.0, 30.0)
    one.scores["psnr_floor"] = 35.0
    said = standing(found, one, views_of(half_covered()), looks=True)
    assert said.broken == ""
    assert said.note == "30.0 dB, a copy of the nearest training view 35.0 dB"


def test_of_several_seeds_the_worst_counts() -> None:
    good, bad, none = RungScore(0.9, ""), RungScore(0.2, "explains 20%"), RungScore(None, "diverged: x")
    assert worst([good, bad]) is bad
    assert worst([bad, none, good]) is none


def test_the_first_broken_rung_is_the_one_that_counts() -> None:
    whole, broken = RungScore(0.9, ""), RungScore(0.1, "explains 10%")
    assert rungs_climbed([whole, whole, broken, whole, broken]) == 2
    assert rungs_climbed([whole] * 5) == 5
    assert _row(FREQUENCY, "nerf", [whole, whole, broken, whole, broken])[2] == "3: 11 cycles around the ball"
    assert _row(FREQUENCY, "nerf", [whole] * 5)[2] == "none"


@pytest.mark.parametrize(("method", "first", "status", "broke"), [
    ("nerf", RungScore(0.9, ""), "pass", False),
    ("nerf", RungScore(0.1, "explains 10%"), "fail", True),
    ("qnerf", RungScore(0.1, "explains 10%"), "fail", False),
])  # fmt: skip
def test_what_is_ours_must_climb_the_first_rung(method: str, first: RungScore, status: str, broke: bool) -> None:
    found = left_behind(Path(), cell("frequency_1", method, 0, []))
    outcome = _outcome(FREQUENCY, found, method, [first, *[RungScore(0.1, "explains 10%")] * 4])
    assert (outcome.status, outcome.is_broken) == (status, broke)


def test_a_method_that_is_not_available_is_no_failure() -> None:
    missing = cell("frequency_1", "nerf", 0, [], status="not_available", reason="no LLVM")
    outcome = _outcome(FREQUENCY, left_behind(Path(), missing), "nerf", [RungScore(None, "not_available: no LLVM")] * 5)
    assert (outcome.status, outcome.why, outcome.is_broken) == ("not_available", "no LLVM", False)


def test_the_control_must_be_climbed_whole() -> None:
    assert set(LEAST_RUNGS) == set(LADDERS)
    scale = LADDERS["scale"]
    found = left_behind(Path(), cell("scale_1", "nerf", 0, []))
    whole, broken = RungScore(0.9, ""), RungScore(0.1, "explains 10%")
    assert _outcome(scale, found, "nerf", [whole] * 5).status == "pass"
    assert _outcome(scale, found, "nerf", [*[whole] * 4, broken]).is_broken
