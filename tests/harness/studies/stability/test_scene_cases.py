"""The criteria of the cases about scenes: noise, closed forms, gaps, refusals. Nothing here is trained."""

import math
from pathlib import Path

import numpy as np
import pytest

from harness.command.plan_options import planned
from harness.studies.stability.whole_scenes import scene_truth
from harness.studies.stability.whole_scenes.scene_cases import (
    FIGURES,
    RAW,
    StressScene,
    _grazing_chord,
    above_the_copy,
    covered_share,
    depth_of_truth,
    over_best_constant,
    refused,
    silhouette,
    textbook_scores,
    virtual_depth,
    z_of_thin_wires,
)
from harness.studies.stability.whole_scenes.scene_truth import (
    PROFILE,
    SCENES,
    SceneRun,
    Views,
    closed_form,
    colour_variance,
    each_method,
    scores_table,
    unexplained,
    worst_z,
    z_score,
)
from scenes.catalog.entries import STRESS
from scenes.catalog.stress.wires import RESOLUTION
from scenes.modelling.normalise import Similarity
from scenes.modelling.truth import Seen, pixel_means
from scenes.view_sets.viewpoints import FOV_X_RADIANS
from tests.harness.cells import cell, checkpoint
from tests.harness.studies.stability.made_up import context_in, pictured, run_of


def noisy_views(bias: float = 0.0, noise: float = 0.05, seed: int = 0) -> Views:
    """Two views of 40 × 40 with known truth and correctly estimated noise."""
    generator = np.random.default_rng(seed)
    truth = generator.uniform(0.2, 0.8, (2, 40, 40, 4))
    halves = [truth + bias + noise * math.sqrt(2) * generator.standard_normal(truth.shape) for _ in range(2)]
    variance = (halves[0] - halves[1]) ** 2 / 4
    depth = np.ones(truth.shape[:3])
    return Views(("a", "b"), (halves[0] + halves[1]) / 2, variance, truth, depth, depth)


def test_noise_is_within_the_limits_and_a_bias_is_not() -> None:
    scores = [worst_z(noisy_views(seed=seed)) for seed in range(20)]
    assert max(scores) < 4.0
    assert 0.8 < np.mean(scores) < 2.5, "the largest of four normal numbers"
    assert unexplained(noisy_views()) == pytest.approx(1.0, abs=0.1)
    # a tenth of the noise of a pixel: invisible in it, and four standard errors of the mean of 3200
    assert worst_z(noisy_views(bias=0.007)) > 4.0
    assert unexplained(noisy_views(bias=0.05)) > 1.5


def test_without_noise_nothing_may_differ() -> None:
    assert z_score(0.25, 0.25, 0.0) == 0.0
    assert z_score(0.25, 0.26, 0.0) == math.inf
    assert z_score(1.0, 0.0, 0.25) == 2.0
    assert unexplained(noisy_views(noise=0.0)) == 0.0
    assert worst_z(noisy_views(noise=0.0, bias=0.01)) == math.inf


def test_depth_is_compared_where_a_pixel_is_covered() -> None:
    views = noisy_views()
    run = run_of(Path(), cell("wall", "nerf", 0, []))
    (none,) = depth_of_truth(scene_of(run, views, "wall"))
    assert none.is_broken, "no pixel is completely covered"
    ones = np.ones_like(views.truth)
    depth = views.depth.copy()
    depth[1, 3, 3] = 1.5
    covered = Views(views.names, ones, views.variance, ones, depth, views.true_depth)
    (half,) = depth_of_truth(scene_of(run, covered, "wall"))
    assert half.value == pytest.approx(0.5)
    assert views.of("b").names == ("b",)
    assert np.array_equal(views.of("b").truth[0], views.truth[1])


def test_the_variance_is_that_about_one_flat_colour() -> None:
    assert colour_variance(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])) == 0.25
    assert colour_variance(np.array([[0.2, 0.5, 0.8]] * 3)) == pytest.approx(0.0)


def test_textbook_scores_of_identical_images_are_not_finite() -> None:
    flat = np.ones((8, 8, 3))
    assert textbook_scores(flat, flat)["psnr"] == math.inf
    assert math.isnan(textbook_scores(flat, flat)["ssim"])
    picture = np.random.default_rng(0).uniform(size=(8, 8, 3))
    assert textbook_scores(picture, picture)["ssim"] == pytest.approx(1.0)
    assert textbook_scores(picture, picture + 0.1)["psnr"] == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("scene", "warnings", "error", "status"),
    [
        ("wires", ["empty collapse: x"], 0.5, "not_applicable"),
        ("empty", ["empty collapse: x"], 0.5, "pass"),
        ("wires", ["gap: x"], 0.5, "pass"),
        ("wires", [], 0.99, "fail"),
    ],
)
def test_a_cell_that_learnt_nothing_never_passes(
    scene: str, warnings: list[str], error: float, status: str, tmp_path: Path
) -> None:
    run = run_of(tmp_path, cell(scene, "nerf", 0, [checkpoint(1, 1.0, 20.0)], warnings=warnings))
    (outcome,) = each_method(run, scene, "error", lambda _: error, high=0.9)
    assert (outcome.status, outcome.value) == (status, error), "the figure is recorded in any case"
    assert ("learnt nothing in" in outcome.why) == (status == "not_applicable")
    (row,) = scores_table("S4" if scene == "wires" else "S1", run).rows
    assert ("learnt nothing" in str(row[-1])) == (status == "not_applicable")


def test_a_picture_that_is_dark_without_opacity_is_judged(tmp_path: Path) -> None:
    pictures = pictured(tmp_path, np.zeros((8, 8, 3)))
    run = run_of(tmp_path, cell("glass_air", "qnerf", 0, [], pictures=pictures, warnings=["empty collapse: x"]))
    (outcome,) = each_method(run, "glass_air", "share", lambda _: -70.0, low=0.3)
    assert outcome.status == "fail"


def scene_of(run: SceneRun, views: Views, name: str = "white") -> StressScene:
    return StressScene(context_in(run.out), run, name, views)


def test_scores_that_are_compared_with_a_trivial_picture() -> None:
    ones = np.ones((1, 4, 4, 4))
    depth = np.repeat([[8.0, 9.0]], 8).reshape(1, 4, 4)
    record = cell("wall", "nerf", 0, [], scores={"psnr": 15.8, "psnr_floor": 13.6, "depth_rmse": 2.4})
    scene = scene_of(run_of(Path(), record), Views(("a",), ones, ones, ones, depth, depth))
    assert above_the_copy(scene, record) == pytest.approx(2.2)
    assert over_best_constant(scene, record) == pytest.approx(4.8)
    record.scores.update({"psnr": None, "depth_rmse": None})
    assert above_the_copy(scene, record) is over_best_constant(scene, record) is None


def test_a_white_veil_is_not_a_silhouette(tmp_path: Path) -> None:
    """The figure is 0 if everything is opaque, and 1 if only the silhouette is."""
    truth = np.zeros((1, 8, 8, 4))
    truth[0, 4:] = 1.0
    views = Views(("test/r_0",), truth, truth, truth, truth[..., 0], truth[..., 0])
    for opacity, figure in ((np.ones((8, 8)), 0.0), (truth[0, ..., 0], 1.0)):
        record = cell("white", "nerf", 0, [], pictures=pictured(tmp_path, np.stack([opacity] * 3, -1)))
        assert silhouette(scene_of(run_of(tmp_path, record), views), record) == pytest.approx(figure)


def test_the_closed_form_of_a_pixel_is_free_of_bias(monkeypatch: pytest.MonkeyPatch) -> None:
    """Edges at the same place of every pixel: even grids have the same error everywhere, random points only noise."""
    size, fov = 24, FOV_X_RADIANS
    wide = 2 * math.tan(fov / 2) / size

    def stripes(o: np.ndarray, d: np.ndarray) -> Seen:
        light = (d[:, 0] / -d[:, 2] / wide % 1.0 < 0.53).astype(float)
        return Seen(np.repeat(light[:, None], 3, axis=1), np.ones(len(d)), np.ones(len(d)))

    def pull(seed: int) -> float:
        mean, variance, _ = closed_form(stripes, np.eye(4), size, size, seed)
        return z_score(float(mean[..., 0].mean()), 0.53, float(variance[..., 0].sum()) / size**4)

    assert max(abs(pull(seed)) for seed in range(6)) < 4.0

    def even(*arguments: object) -> tuple[np.ndarray, np.ndarray]:
        return pixel_means(*arguments[:5])  # type: ignore[arg-type]

    monkeypatch.setattr(scene_truth, "pixel_means", even)
    assert abs(pull(0)) > 4.0


@pytest.mark.slow
def test_wires_that_pixel_centres_miss_are_rendered_in_proportion() -> None:
    z, hits = z_of_thin_wires(1e-2, 48)
    assert abs(z) < 4.0
    assert hits > 100


def test_raw_scales_are_refused_and_the_unit_is_not() -> None:
    assert all(refused(change) for change in RAW.values())
    assert not refused(Similarity(1.0, (0.0, 0.0, 0.0)))


def test_every_stress_scene_has_its_case_and_the_size_it_is_made_for() -> None:
    assert sorted(scene for scenes in SCENES.values() for scene in scenes) == sorted(STRESS)
    assert sorted([*FIGURES, *SCENES["S7"]]) == sorted(STRESS)
    assert planned(PROFILE, precision="float32").views.resolution == RESOLUTION


def test_a_grazing_ray_is_cut_exactly_and_samples_are_not() -> None:
    ours, usual = _grazing_chord()
    assert ours.status == "pass"
    assert usual.status == "fail"
    assert usual.value is not None
    assert usual.value > 0.05


def test_covered_share_is_in_proportion_to_width() -> None:
    """By area from thick wires, and by enough rays to hit the thin ones."""
    assert covered_share(0.1, 40, 0) == pytest.approx(covered_share(0.1, 40, 15), rel=0.05)
    assert covered_share(1e-4, 12, 1) == 0.0, "rays through pixel centres miss them all"


def test_the_image_in_the_mirror_lies_behind_it() -> None:
    assert 0.1 < virtual_depth() < 2.0
