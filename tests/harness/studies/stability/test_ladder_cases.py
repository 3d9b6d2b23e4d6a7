"""The criteria for broken methods and costly omissions, on records written by hand."""

from pathlib import Path

import numpy as np
import pytest

from harness.records.cells import CellRecord
from harness.studies.choices.omissions import Omission, Verdict
from harness.studies.stability.whole_scenes.ladder_cases import (
    LEAST_RUNGS,
    RungScore,
    _worst,
    outcome_of,
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


def views_of(rgba: np.ndarray) -> ViewSet:
    test = Split(("test/r_0",), np.eye(4)[None], ImageStack.of([rgba.astype(np.float32)]))
    none = Split((), np.zeros((0, 4, 4)), ImageStack((8, 8, 4)))
    box = np.array([[-1.0] * 3, [1.0] * 3])
    return ViewSet(Path(), "x", "x", 8, 8, 0.7, 2.0, 6.0, box, none, none, test)


def half_covered() -> np.ndarray:
    """A white upper half, and a lower half covered by stripes of 0.2 and 0.8, whose variance is 0.09."""
    rgba = np.zeros((8, 8, 4))
    rgba[4:, ::2, :3], rgba[4:, 1::2, :3] = 0.2, 0.8
    rgba[4:, :, 3] = 1.0
    return rgba


def shown_as(tmp_path: Path, stripes: float, psnr: float) -> tuple[SceneRun, CellRecord]:
    """A cell that shows the background exactly, and the stripes with that contrast about their mean."""
    image = np.ones((8, 8, 3))
    image[4:, ::2], image[4:, 1::2] = 0.5 - 0.3 * stripes, 0.5 + 0.3 * stripes
    record = cell("frequency_1", "nerf", 0, [checkpoint(1, 1.0, psnr)], pictures=pictured(tmp_path, image))
    return run_of(tmp_path, record), record


@pytest.mark.parametrize(("contrast", "share"), [(1.0, 1.0), (0.0, 0.0), (0.5, 0.75)])
def test_looks_are_judged_within_the_silhouette(tmp_path: Path, contrast: float, share: float) -> None:
    run, record = shown_as(tmp_path, contrast, 20.0)
    assert share_of_looks(run, record, views_of(half_covered())) == pytest.approx(share, abs=0.01)


def test_shape_is_judged_over_complete_views() -> None:
    variance = (0.5 * 1.0 + 0.25 * 0.04 + 0.25 * 0.64) - 0.75**2
    mse = mse_over_tests(cell("frequency_1", "nerf", 0, []))
    assert mse == pytest.approx(0.01)
    assert share_of_views(0.01, views_of(half_covered())) == pytest.approx(1 - 0.01 / variance)


def test_only_a_silhouette_is_broken_and_so_is_a_cell_without_scores(tmp_path: Path) -> None:
    run, record = shown_as(tmp_path, 0.0, 13.0)
    views = views_of(half_covered())
    assert score_of(run, record, views, looks=True).broken.startswith("explains")
    assert score_of(run, record, views, looks=False).broken == "", "the silhouette is most of a complete view"
    score = score_of(run, diverged("frequency_1", "nerf", 0), views, looks=True)
    assert score == (None, "diverged: not finite at step 7: loss")


GOOD, BROKEN = RungScore(0.9, ""), RungScore(0.1, "explains 10%")


def test_the_worst_of_several_seeds_and_the_first_broken_rung_count() -> None:
    none = RungScore(None, "diverged: x")
    assert worst([GOOD, BROKEN]) is BROKEN
    assert worst([BROKEN, none, GOOD]) is none
    assert rungs_climbed([GOOD, GOOD, BROKEN, GOOD, BROKEN]) == 2
    assert rungs_climbed([GOOD] * 5) == 5


@pytest.mark.parametrize(
    ("ladder", "method", "climbed", "status", "broke"),
    [
        ("frequency", "nerf", [GOOD, *[BROKEN] * 4], "pass", False),
        ("frequency", "nerf", [BROKEN] * 5, "fail", True),
        ("frequency", "qnerf", [BROKEN] * 5, "fail", False),
        ("scale", "nerf", [GOOD] * 5, "pass", False),
        ("scale", "nerf", [*[GOOD] * 4, BROKEN], "fail", True),
    ],
)
def test_a_method_of_this_harness_must_climb_the_required_rungs(
    ladder: str, method: str, climbed: list[RungScore], status: str, broke: bool
) -> None:
    run = run_of(Path(), cell(f"{ladder}_1", method, 0, []))
    outcome = outcome_of(LADDERS[ladder], run, method, climbed)
    assert (outcome.status, outcome.is_broken) == (status, broke)


def test_a_method_that_is_not_available_does_not_fail() -> None:
    assert set(LEAST_RUNGS) == set(LADDERS)
    missing = cell("frequency_1", "nerf", 0, [], status="not_available", reason="no LLVM")
    none = [RungScore(None, "not_available: no LLVM")] * 5
    outcome = outcome_of(LADDERS["frequency"], run_of(Path(), missing), "nerf", none)
    assert (outcome.status, outcome.why, outcome.is_broken) == ("not_available", "no LLVM", False)


# what a scene does not need


def omission(
    verdict: Verdict,
    difference: float | None,
    interval: tuple[float, float] | None = (-0.01, 0.01),
    scene: str = "tiny",
    pairs: int = 3,
) -> Omission:
    return Omission(scene, "nerf", "empty_space", 1.0, "training", difference, interval, pairs, 3 - pairs, verdict)


WITHIN = omission("within its bound", 0.01)


@pytest.mark.parametrize(
    ("omitted", "status", "value", "words"),
    [
        ([WITHIN, omission("within its bound", -0.02, scene="materials")], "pass", 0.02, "2.0 s saved"),
        (
            [omission("inconclusive", -9.0), omission("costs more", -0.5, scene="materials")],
            "fail", 0.5, "costs more on materials",
        ),
        ([WITHIN, omission("inconclusive", -0.02, (-0.6, 0.1))], "inconclusive", 0.02, "[-0.6, +0.1] dB"),
        ([WITHIN, omission("inconclusive", -0.4, (-0.6, 0.1))], "inconclusive", 0.4, "[-0.6, +0.1] dB"),
        (
            [WITHIN, omission("inconclusive", None, None, "materials", pairs=0)],
            "not_available", None, "materials: samples in empty space: nothing measured",
        ),
        ([omission("costs more", None, None, pairs=0)], "fail", None, "costs more on tiny"),
    ],
)  # fmt: skip
def test_the_worst_scene_of_an_omission_decides(
    omitted: list[Omission], status: str, value: float | None, words: str
) -> None:
    outcome = _worst(omitted)
    assert (outcome.status, outcome.value, outcome.limit) == (status, value, WITHIN.bound)
    assert words in outcome.why
