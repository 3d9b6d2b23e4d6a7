"""What the cases about scenes judge by: noise, closed forms, gaps, refusals. Nothing here is rendered or trained."""

import math

import numpy as np
import pytest

from harness.stability.light_cases import _fog_by_quadrature, _grazing_chord, covered_share, virtual_depth
from harness.stability.scene_cases import RAW, misnamed_gap, psnr_apart, refused
from harness.stability.scene_findings import PROFILE, SCENES, mse_over_tests
from harness.stability.scene_truth import (
    Views,
    colour_variance,
    depth_error,
    explained_share,
    unexplained,
    worst_z,
    z_score,
)
from harness.stability.textbook_scores import textbook_scores
from scenes.catalog import STRESS
from scenes.normalise import Similarity
from tests.harness.cells import cell, checkpoint


def noisy_views(bias: float = 0.0, noise: float = 0.05, seed: int = 0) -> Views:
    """Two views of 40 × 40 whose truth is known and whose noise is what they say it is."""
    generator = np.random.default_rng(seed)
    truth = generator.uniform(0.2, 0.8, (2, 40, 40, 4))
    halves = [truth + bias + noise * math.sqrt(2) * generator.standard_normal(truth.shape) for _ in range(2)]
    variance = (halves[0] - halves[1]) ** 2 / 4
    depth = np.ones(truth.shape[:3])
    return Views(("a", "b"), (halves[0] + halves[1]) / 2, variance, truth, depth, depth)


def test_noise_alone_is_within_the_bars_and_a_bias_is_not() -> None:
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
    assert math.isnan(depth_error(views)), "no pixel is covered from border to border"
    ones = np.ones_like(views.truth)
    depth = views.depth.copy()
    depth[1, 3, 3] = 1.5
    assert depth_error(Views(views.names, ones, views.variance, ones, depth, views.true_depth)) == pytest.approx(0.5)
    assert views.of("b").names == ("b",)
    assert np.array_equal(views.of("b").truth[0], views.truth[1])


def test_explained_share_is_one_minus_error_over_variance() -> None:
    pixels = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    assert colour_variance(pixels) == 0.25
    assert explained_share(0.0, 0.25) == 1.0
    assert explained_share(0.25, 0.25) == 0.0, "one flat colour"
    views = [cell("a", "nerf", 0, [checkpoint(1, 1.0, 20.0)])][0]
    assert mse_over_tests(views) == pytest.approx(0.01)


def test_textbook_scores_of_identical_images_are_no_numbers() -> None:
    flat = np.ones((8, 8, 3))
    assert textbook_scores(flat, flat)["psnr"] == math.inf
    assert math.isnan(textbook_scores(flat, flat)["ssim"])
    picture = np.random.default_rng(0).uniform(size=(8, 8, 3))
    assert textbook_scores(picture, picture)["ssim"] == pytest.approx(1.0)
    assert textbook_scores(picture, picture + 0.1)["psnr"] == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("train", "test", "warnings", "wrong"),
    [(22.0, 8.0, ["billboard: x"], False), (22.0, 18.0, ["gap: x"], False), (22.0, 18.0, [], True),
     (22.0, 21.0, [], False), (22.0, 21.0, ["billboard: x"], True), (None, None, [], False)],
)  # fmt: skip
def test_a_gap_must_be_named_and_only_a_gap(
    train: float | None, test: float | None, warnings: list[str], wrong: bool
) -> None:
    one = cell("wall", "nerf", 0, [], scores={"psnr_train": train, "psnr": test}, warnings=warnings)
    assert misnamed_gap(one) is wrong


def test_raw_scales_are_refused_and_the_unit_is_not() -> None:
    assert all(refused(change) for change in RAW.values())
    assert not refused(Similarity(1.0, (0.0, 0.0, 0.0)))


def test_scores_apart() -> None:
    one, two = (cell("tiny", "nerf", 0, [checkpoint(1, 1.0, psnr)]) for psnr in (20.0, 21.5))
    assert psnr_apart(one, two) == 1.5
    assert psnr_apart(one, None) is None


def test_every_stress_scene_has_its_case() -> None:
    named = [scene for scenes in SCENES.values() for scene in scenes]
    assert sorted(named) == sorted(STRESS)
    assert PROFILE == "stress"


@pytest.mark.parametrize(("scene", "tau"), [("fog_dense", 50.0), ("fog_thin", 1e-3)])
def test_our_rule_meets_the_closed_form_of_fog_and_the_printed_one_does_not(scene: str, tau: float) -> None:
    ours, printed = _fog_by_quadrature(scene, tau)
    assert (ours.status, ours.whose) == ("pass", "ours")
    assert (printed.status, printed.whose) == ("fail", "paper")


def test_a_grazing_ray_is_cut_exactly_and_samples_are_not() -> None:
    ours, usual = _grazing_chord()
    assert ours.status == "pass"
    assert usual.status == "fail"
    assert usual.figure is not None
    assert usual.figure > 0.05


def test_covered_share_is_in_proportion_to_width() -> None:
    """By area from thick wires, and by so many rays that they find the thin ones."""
    assert covered_share(0.1, 40, 0) == pytest.approx(covered_share(0.1, 40, 15), rel=0.05)
    assert covered_share(1e-4, 12, 1) == 0.0, "rays through pixel centres miss them all"


def test_the_image_in_the_mirror_lies_behind_it() -> None:
    assert 0.1 < virtual_depth() < 2.0
