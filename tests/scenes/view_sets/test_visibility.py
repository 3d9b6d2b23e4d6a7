"""Cameras that see nothing are refused before training, with the likely cause."""

import re
from collections.abc import Callable
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


def opaque(views: ViewSet) -> ViewSet:
    return with_training(views, *[np.ones((SIZE, SIZE, 4))] * 8)


def empty(views: ViewSet) -> ViewSet:
    return with_training(views, *[np.zeros((SIZE, SIZE, 4))] * 8)


def with_tests(views: ViewSet, turn: np.ndarray) -> ViewSet:
    """The training views as test views, their cameras turned."""
    names = tuple(f"test/r_{k}" for k in range(8))
    return replace(views, test=Split(names, views.train.camera_to_world @ turn, views.train.rgba))


def box_beside_the_ball(views: ViewSet) -> ViewSet:
    """Rays meet it, those of covered pixels do not."""
    views = with_poses(views, poses_on_sphere(np.linspace(0.0, 6.0, 8), np.full(8, 0.1), RADIUS))
    views = replace(views, bounds=np.array([[-0.05, -0.05, -1.35], [0.05, 0.05, -1.25]]))
    assert visibility_of(views).rays > 0.0
    return views


NOTHING = "0% of the covered training pixels see the box"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda views: with_poses(views, views.train.camera_to_world @ OPENCV), f"{NOTHING} .*OpenCV's axes, y down"),
        (lambda views: replace(views, near=0.1, far=2.0), f"{NOTHING} .*--near, --far"),
        (lambda views: replace(views, near=4.0, far=4.0 + 1e-7), f"{NOTHING} .*--near, --far"),
        (lambda views: replace(views, bounds=views.bounds + 50.0), f"{NOTHING} .*--bounds"),
        (box_beside_the_ball, NOTHING),
        (lambda views: with_poses(views, np.linalg.inv(views.train.camera_to_world)), "world-to-camera: invert them"),
        (lambda views: with_poses(views, np.linalg.inv(views.train.camera_to_world @ OPENCV)), "then negate"),
        (lambda views: with_tests(views, OPENCV), "0% of the covered test pixels see the box .*OpenCV's axes"),
        (empty, "no training view has a covered pixel; save the object's silhouette"),
    ],
)
def test_cameras_that_see_nothing_are_refused(wrong: Callable[[ViewSet], ViewSet], message: str) -> None:
    views = wrong(ball_seen())
    with pytest.raises(InputError, match=f"^ball: .*{message}"):
        cautions(views, visibility_of(views))


def one_turned_camera(_: ViewSet) -> ViewSet:
    views = ball_seen(20)
    poses = views.train.camera_to_world.copy()
    poses[3] = poses[3] @ OPENCV
    return with_poses(views, poses)


def shown_twice(views: ViewSet) -> ViewSet:
    disc = views.train.rgba[0]
    return replace(views, test=Split(("test/a", "test/b"), views.train.camera_to_world[:2], stack(disc, 0.5 * disc)))


@pytest.mark.parametrize(
    ("odd", "sentence"),
    [
        (one_turned_camera, "1 of 20 training cameras see little or nothing of the box.*others see it: train/r_3$"),
        (opaque, "no training view has a transparent pixel"),
        (lambda views: replace(empty(views), rendered={"variant": ""}), "no training view has a covered pixel$"),
        (shown_twice, "test pictures are training pictures: test/a shows what train/r_7 shows$"),
        (lambda views: with_tests(views, np.eye(4)), "test pictures are training pictures"),
        (lambda views: replace(views, bounds=0.3 * views.bounds),
         "only [0-9]+% of the covered training pixels see the box -0.3"),
        (lambda views: replace(views, repeated_views=("test: r_0 has the camera of train: r_1", "another")),
         "cameras repeat: test: r_0 has the camera of train: r_1, and 1 more$"),
    ],
)  # fmt: skip
def test_what_is_odd_is_one_caution(odd: Callable[[ViewSet], ViewSet], sentence: str) -> None:
    views = odd(ball_seen())
    (said,) = cautions(views, visibility_of(views))
    assert re.match(sentence, said)


def test_inverted_alpha_is_a_caution_and_no_alpha_is_none() -> None:
    views = ball_seen()
    inverted = with_training(views, *[1.0 - views.train.rgba[0]] * 8)
    assert any("alpha seems inverted" in sentence for sentence in cautions(inverted, visibility_of(views)))
    without = replace(opaque(views), notes=("Images without alpha count as opaque.",))
    assert visibility_of(without).covered is None, "only rays count"
    assert cautions(without, visibility_of(without)) == []


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
