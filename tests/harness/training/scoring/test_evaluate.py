"""Scores of whole splits, the floor, histograms and properties, and what taking an amplifier out changes."""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
import torch

from baselines.amplifiers import without_effect
from baselines.numerics.encoding import PHI
from harness.records.cells import ViewScore
from harness.training.scoring import evaluate
from harness.training.scoring.amplifier_effect import amplifier_effect
from harness.training.trainer import Diverged
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.pixels import decode_srgb, over_white
from scenes.view_sets.view_set import Split, ViewSet
from tests.harness.tiny import CPU, train, trainer


def view_of(rgba: np.ndarray, error: float = 0.0) -> evaluate.View:
    """Return the truth with an offset of `error` and a depth of 4."""
    return evaluate.View(over_white(rgba) + error, rgba[..., 3], np.full(rgba.shape[:2], 4.0))


def test_quick_scores_average_over_views_and_keep_identical_images_from_being_infinite(ball: ViewSet) -> None:
    errors = [0.1, 0.01, 0.001]
    images = [view_of(rgba, error) for rgba, error in zip(ball.test.rgba, errors, strict=True)]
    assert evaluate.quick_scores(images, ball.test)["psnr"] == pytest.approx((20 + 40 + 60) / 3, abs=1e-3)
    same = evaluate.quick_scores([view_of(rgba) for rgba in ball.test.rgba], ball.test)
    assert (same["psnr"], same["rmse_linear"]) == (evaluate.LARGEST_PSNR, 0.0)
    assert same["ssim"] == pytest.approx(1.0)


def test_a_view_gets_every_score_that_its_truth_allows(ball: ViewSet) -> None:
    image = view_of(ball.test.rgba[1], 0.1)
    plain = evaluate.view_scores(image, ball.test, 1)
    assert plain.view == "test/r_1"
    assert plain.psnr == pytest.approx(20.0, abs=1e-3)
    assert plain.opacity_iou == 1.0
    assert (plain.depth_rmse, plain.psnr_ceiling) == (None, None)
    depth = np.full(ball.test.rgba.shape[:3], 3.5, dtype=np.float32)
    rich = replace(ball.test, depth=ImageStack.of(depth), noise_mse=np.array([1e-2, 1e-4, 1e-6]))
    whole = evaluate.view_scores(image, rich, 1)
    assert whole.depth_rmse == pytest.approx(0.5)
    assert whole.psnr_ceiling == pytest.approx(40.0)


def test_means_leave_out_the_views_that_lack_a_score() -> None:
    rows = [ViewScore("a", psnr=20.0, ssim=0.5, flip=0.1, delta_e=1.0, rmse_linear=0.1, depth_rmse=0.3)]
    rows.append(ViewScore("b", 40.0, ssim=0.7, flip=0.3, delta_e=3.0, rmse_linear=0.2))
    means = evaluate.mean_scores(rows)
    assert means == pytest.approx(
        {"psnr": 20.0, "ssim": 0.6, "flip": 0.2, "delta_e": 2.0, "rmse_linear": 0.15, "depth_rmse": 0.3,
         "opacity_iou": None, "psnr_ceiling": 40.0, "rel_mse": None, "smape": None, "hdr_flip": None,
         "lpips": None}
    )  # fmt: skip


def test_the_floor_answers_each_test_view_with_the_nearest_training_view(ball: ViewSet) -> None:
    best = []
    for pose, rgba in zip(ball.test.camera_to_world, ball.test.rgba, strict=True):
        distances = [math.dist(pose[:3, 3], other[:3, 3]) for other in ball.train.camera_to_world]
        nearest = ball.train.rgba[distances.index(min(distances))]
        best.append(-10 * math.log10(np.mean((over_white(nearest).astype(float) - over_white(rgba)) ** 2)))
    assert evaluate.floor_psnr(ball) == pytest.approx(sum(best) / 3, abs=1e-4)


@pytest.mark.parametrize("method", ["nerf", "qnerf", "qnerf_printed"])
def test_a_histogram_ends_at_the_limit_of_the_method(method: str) -> None:
    learner = trainer(method)
    last = {"nerf": 1e3, "qnerf": 25.0, "qnerf_printed": learner.box.half_extent}[method]
    histogram = evaluate.density_histogram(learner, points=6)
    assert histogram["edges"][-1] == pytest.approx(last)
    assert len(histogram["edges"]) == len(histogram["before"]) + 1
    assert sum(histogram["before"]) == sum(histogram["after"]) == pytest.approx(1.0)


def test_a_density_that_is_not_finite_is_a_divergence() -> None:
    learner = trainer()
    with torch.no_grad():
        learner.coarse.density_head.bias[:] = math.nan
    with pytest.raises(Diverged, match="density after the amplifier"):
        evaluate.density_histogram(learner, points=4)


def test_chunks_change_the_listed_method_and_no_other(ball: ViewSet) -> None:
    cameras = evaluate.cameras_of(ball, ball.test, CPU)
    trainers = {method: trainer(method) for method in ("nerf", "qnerf")}
    # at its first value 1/φ the amplifier is the identity about any mean
    torch.nn.init.constant_(trainers["qnerf"].field.amplifier.get_parameter("alpha"), 1.0)
    found = {method: evaluate.measured_properties(one, cameras) for method, one in trainers.items()}
    differences = {method: float(one["chunk_max_difference"] or 0) for method, one in found.items()}
    assert differences["nerf"] < 1e-5
    assert differences["qnerf"] > 10 * differences["nerf"]
    largest = float(found["qnerf"]["largest_density"] or 0)
    assert 1 < largest <= 25
    assert found["qnerf"]["opacity_unit_slab"] == pytest.approx(1 - math.exp(-largest))
    assert found["nerf"]["occupied_share"] == 1.0


def test_unclipped_light_is_scored_where_the_scene_needs_it(ball: ViewSet) -> None:
    colour = over_white(ball.test.rgba[0])
    view = evaluate.View(colour, ball.test.rgba[0][..., 3], np.zeros(colour.shape[:2]))
    bright = replace(ball.test, light=lambda name: 4.0 * decode_srgb(colour) if name == ball.test.names[0] else None)
    assert evaluate.view_scores(view, ball.test, 0).smape is None
    scores = evaluate.view_scores(view, bright, 0)
    light = decode_srgb(colour)
    assert scores.smape == pytest.approx(float(np.mean(3.0 * light / (5.0 * light + 0.01))))
    assert scores.psnr == 100.0
    assert evaluate.view_scores(view, bright, 1).smape is None


def ball_seen(ball: ViewSet, index: int, turned: float) -> tuple[evaluate.View, Split]:
    """Return the exact view of the unit ball, and its split with normals turned by an angle."""
    cameras = evaluate.cameras_of(ball, ball.test, CPU)
    rays = cameras.all_rays(index)
    along = -(rays.origins * rays.directions).sum(-1)
    inside = 1.0 - (rays.origins.square().sum(-1) - along**2)
    depth = torch.where(inside > 0, along - inside.clamp(min=0.0).sqrt(), 0.0)
    normal = rays.origins + depth[:, None] * rays.directions
    across = torch.nn.functional.normalize(torch.linalg.cross(normal, rays.directions), dim=-1)
    normal = math.cos(turned) * normal + math.sin(turned) * across
    normal = torch.where((inside > 0)[:, None], normal, 0.0).reshape(24, 24, 3).numpy()
    rgba = ball.test.rgba[index]
    view = evaluate.View(over_white(rgba), rgba[..., 3], depth.reshape(24, 24).numpy())
    stack = ImageStack.of(np.stack([normal.astype(np.float32)] * len(ball.test.names)))
    return view, replace(ball.test, normal=stack)


def ball_density(x: torch.Tensor) -> torch.Tensor:
    return torch.exp(20.0 * (1.0 - x.norm(dim=-1)))


@pytest.mark.parametrize(
    ("density", "turned", "expected"),
    [(ball_density, 0.0, 0.0), (ball_density, 20.0, 20.0), (lambda x: torch.ones(len(x)), 0.0, 90.0)],
)
def test_the_angle_between_normals_is_that_by_which_the_truth_is_turned_and_90_without_a_normal(
    ball: ViewSet, density: Callable[[torch.Tensor], torch.Tensor], turned: float, expected: float
) -> None:
    learner = trainer()
    learner.field.density = density
    cameras = evaluate.cameras_of(ball, ball.test, CPU)
    view, split = ball_seen(ball, 1, math.radians(turned))
    assert evaluate.normal_error(learner, view, cameras, split, 1) == pytest.approx(expected, abs=0.5)
    assert evaluate.normal_error(learner, view, cameras, ball.test, 1) is None
    nothing = replace(view, opacity=np.zeros_like(view.opacity))
    assert evaluate.normal_error(learner, nothing, cameras, split, 1) is None


# how much of a picture is the amplifier

CHUNK = 64


def effect_of(method: str, alpha: float, ball: ViewSet) -> dict[str, float | None]:
    learner = train(trainer(method), 3)
    amplifier = learner.field.amplifier
    if hasattr(amplifier, "alpha"):
        with torch.no_grad():
            amplifier.alpha.fill_(alpha)
            if hasattr(amplifier, "beta"):
                amplifier.beta.fill_(1.0)
    cameras = evaluate.cameras_of(ball, ball.test, CPU)
    images = evaluate.render_split(learner, cameras, CHUNK)
    scored = [evaluate.view_scores(image, ball.test, index).psnr for index, image in enumerate(images)]
    return amplifier_effect(learner, cameras, ball.test, scored, CHUNK)


def test_a_method_without_an_amplifier_has_none(ball: ViewSet) -> None:
    assert effect_of("nerf", 1.0, ball) == {}


@pytest.mark.parametrize("factor", [1.0, 2.0])
@pytest.mark.parametrize("method", ["qnerf", "qnerf_theorem", "qnerf_running_mean", "qnerf_running_mean_listing2"])
def test_a_contrast_is_seen_and_the_identity_is_not(method: str, factor: float, ball: ViewSet) -> None:
    found = effect_of(method, factor / PHI, ball)
    assert found["alpha_phi"] == pytest.approx(factor)
    change = abs(found["psnr_without_amplifier"] or 0.0)
    assert change > 1e-3 if factor != 1.0 else change < 1e-4


def test_what_was_learnt_is_put_back_even_after_an_error() -> None:
    amplifier = trainer("qnerf").field.amplifier
    with torch.no_grad():
        amplifier.alpha.fill_(0.9)
        amplifier.beta.fill_(1.3)
    with suppress(KeyError), without_effect([amplifier, None]):
        assert (amplifier.alpha.item(), amplifier.beta.item()) == (pytest.approx(1.0 / PHI), 1.0)
        raise KeyError
    assert (amplifier.alpha.item(), amplifier.beta.item()) == (pytest.approx(0.9), pytest.approx(1.3))
