"""Cameras that see nothing are refused before training, with the likely cause."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenes.files.errors import InputError
from scenes.view_sets.cautions import cautions, is_premultiplied
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.view_set import Split, ViewSet
from scenes.view_sets.viewpoints import poses_on_sphere
from scenes.view_sets.visibility import OPENCV, visibility_of

SIZE, FOV, RADIUS = 24, 0.7, 4.0
BALL = 0.9
"""The radius of the ball that the views show, in a box of half-extent 1."""


def stack(*images: np.ndarray) -> ImageStack:
    return ImageStack.of(image.astype(np.float32) for image in images)


def ball_seen(count: int = 8) -> ViewSet:
    """Return views of a ball: from every side it is the same disc."""
    poses = poses_on_sphere(np.linspace(0.0, 6.0, count), np.linspace(0.1, 1.2, count), RADIUS)
    focal = 0.5 * SIZE / np.tan(0.5 * FOV)
    x, y = np.meshgrid(np.arange(SIZE) + 0.5 - SIZE / 2, np.arange(SIZE) + 0.5 - SIZE / 2)
    angle = np.arctan(np.hypot(x, y) / focal)
    image = np.zeros((SIZE, SIZE, 4))
    image[angle < np.arcsin(BALL / RADIUS)] = 1.0
    train = Split(tuple(f"train/r_{k}" for k in range(count)), poses, stack(*[image] * count))
    empty = Split((), np.zeros((0, 4, 4)), ImageStack((SIZE, SIZE, 4)))
    box = np.array([[-1.0] * 3, [1.0] * 3])
    return ViewSet(Path("ball"), "ball", "", SIZE, SIZE, FOV, 2.0, 6.0, box, train, empty, empty)


def with_training(views: ViewSet, *images: np.ndarray) -> ViewSet:
    return replace(views, train=replace(views.train, rgba=stack(*images)))


def with_poses(views: ViewSet, poses: np.ndarray) -> ViewSet:
    return replace(views, train=replace(views.train, camera_to_world=poses))


def test_shares_are_those_of_closed_forms() -> None:
    views = ball_seen()
    result = visibility_of(replace(views, bounds=np.array([[-1e3] * 3, [1e3] * 3])))
    assert (result.rays, result.covered) == (1.0, 1.0)
    # one camera on an axis sees the near side of the box as a square: rays of pixels within it meet the box
    on_axis = np.eye(4)
    on_axis[2, 3] = RADIUS
    one = with_poses(views, np.stack([on_axis] * 8))
    half = np.tan(0.5 * FOV) * (RADIUS - 1.0)
    centres = np.abs((np.arange(SIZE) + 0.5) / SIZE - 0.5) * 2 * half
    assert visibility_of(one).rays == pytest.approx((centres < 1.0).mean() ** 2)
    assert not cautions(views, visibility_of(views))


@pytest.mark.parametrize(
    ("wrong", "cause"),
    [
        (lambda views: with_poses(views, views.train.camera_to_world @ OPENCV), "OpenCV's axes, y down"),
        (lambda views: replace(views, near=0.1, far=2.0), "--near, --far"),
        (lambda views: replace(views, near=4.0, far=4.0 + 1e-7), "--near, --far"),
        (lambda views: replace(views, bounds=views.bounds + 50.0), "--bounds"),
    ],
)
def test_cameras_that_see_nothing_are_refused(wrong, cause) -> None:  # type: ignore[no-untyped-def]
    views = wrong(ball_seen())
    with pytest.raises(InputError, match="0% of the covered training pixels see the box") as sentence:
        cautions(views, visibility_of(views))
    assert cause in str(sentence.value)
    assert str(sentence.value).startswith("ball: ")


def test_a_box_beside_the_object_is_refused_though_rays_meet_it() -> None:
    views = with_poses(ball_seen(), poses_on_sphere(np.linspace(0.0, 6.0, 8), np.full(8, 0.1), RADIUS))
    views = replace(views, bounds=np.array([[-0.05, -0.05, -1.35], [0.05, 0.05, -1.25]]))
    assert visibility_of(views).rays > 0.0
    with pytest.raises(InputError, match="0% of the covered training pixels see the box"):
        cautions(views, visibility_of(views))


@pytest.mark.parametrize(("axes", "cause"), [(np.eye(4), "world-to-camera: invert them"), (OPENCV, "then negate")])
def test_inverted_poses_are_named(axes: np.ndarray, cause: str) -> None:
    views = ball_seen()
    views = with_poses(views, np.linalg.inv(views.train.camera_to_world @ axes))
    with pytest.raises(InputError, match=cause):
        cautions(views, visibility_of(views))


def test_test_cameras_are_looked_at_like_training_cameras() -> None:
    views = ball_seen()
    views = replace(views, test=replace(views.train, names=tuple(f"test/r_{k}" for k in range(8))))
    assert len(cautions(views, visibility_of(views))) == 1, "the same pictures"
    turned = replace(views, test=replace(views.test, camera_to_world=views.test.camera_to_world @ OPENCV))
    with pytest.raises(InputError, match=r"0% of the covered test pixels see the box .*OpenCV's axes"):
        cautions(turned, visibility_of(turned))


def test_single_cameras_that_are_off_are_named() -> None:
    views = ball_seen(20)
    poses = views.train.camera_to_world.copy()
    poses[3] = poses[3] @ OPENCV
    views = with_poses(views, poses)
    (sentence,) = cautions(views, visibility_of(views))
    assert sentence.startswith("1 of 20 training cameras see little or nothing of the box")
    assert sentence.endswith("others see it: train/r_3")
    opaque = with_training(views, *[np.random.default_rng(0).random((SIZE, SIZE, 4)).round()] * 20)
    assert visibility_of(opaque).views.shape == (20,)


def test_odd_alpha_is_a_caution() -> None:
    views = ball_seen()
    disc = next(iter(views.train.rgba))
    inverted = with_training(views, *[1.0 - disc] * 8)
    assert any("alpha seems inverted" in sentence for sentence in cautions(inverted, visibility_of(views)))
    opaque = with_training(views, *[np.ones((SIZE, SIZE, 4))] * 8)
    (sentence,) = cautions(opaque, visibility_of(opaque))
    assert sentence.startswith("no training view has a transparent pixel")
    assert cautions(replace(opaque, notes=("Images without alpha count as opaque.",)), visibility_of(opaque)) == []


def test_pictures_of_test_views_that_were_trained_on_are_named() -> None:
    views = ball_seen()
    disc = next(iter(views.train.rgba))
    test = Split(("test/a", "test/b"), views.train.camera_to_world[:2], stack(disc, 0.5 * disc))
    (sentence,) = cautions(replace(views, test=test), visibility_of(views))
    assert sentence == "test pictures are training pictures: test/a shows what train/r_7 shows"


def test_a_box_that_cuts_the_object_is_a_caution() -> None:
    views = replace(ball_seen(), bounds=np.array([[-0.3] * 3, [0.3] * 3]))
    (sentence,) = cautions(views, visibility_of(views))
    assert re.match("only [0-9]+% of the covered training pixels see the box -0.3", sentence)


def test_without_alpha_only_rays_count() -> None:
    views = ball_seen()
    complete = with_training(views, *[np.ones((SIZE, SIZE, 4))] * 8)
    assert visibility_of(complete).covered is None
    nothing = with_training(views, *[np.zeros((SIZE, SIZE, 4))] * 8)
    with pytest.raises(InputError, match="no training view has a covered pixel; save the object's silhouette"):
        cautions(nothing, visibility_of(nothing))
    rendered = replace(nothing, rendered={"variant": "scalar_rgb"})
    assert cautions(rendered, visibility_of(rendered)) == ["no training view has a covered pixel"]


def test_repeated_cameras_are_a_caution() -> None:
    views = replace(ball_seen(), repeated_views=("test: r_0 has the camera of train: r_1", "another"))
    (sentence,) = cautions(views, visibility_of(views))
    assert sentence == "cameras repeat: test: r_0 has the camera of train: r_1, and 1 more"


@pytest.mark.parametrize("albedo", [0.8, 0.3])
def test_premultiplied_colours_are_suspected_only_of_bright_objects(albedo: float) -> None:
    views = ball_seen()
    edge = np.zeros((SIZE, SIZE, 4))
    edge[4:-4, 4:-4] = [albedo, 0.5 * albedo, 0.0, 1.0]
    edge[4:-4, 4:8, 3] = 0.25
    assert not is_premultiplied(with_training(views, *[edge] * 8))
    edge[..., :3] *= edge[..., 3:]
    assert is_premultiplied(with_training(views, *[edge] * 8)) == (albedo > 0.5)
    assert not is_premultiplied(with_training(views, edge)), "64 pixels are too few"
