"""The measured facts of the NeRF synthetic set's cameras."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes.files.errors import InputError
from scenes.view_sets.viewpoints import (
    SPLITS,
    TILT,
    all_poses,
    camera_to_world,
    check_poses,
    evenly_spread,
    look_at,
    poses_on_sphere,
    repeated,
)


def elevation_of(poses: np.ndarray) -> np.ndarray:
    return np.arcsin(poses[:, 2, 3] / np.linalg.norm(poses[:, :3, 3], axis=1))


def azimuth_of(poses: np.ndarray) -> np.ndarray:
    return np.degrees(np.arctan2(poses[:, 1, 3], poses[:, 0, 3])) % 360


@pytest.mark.parametrize("view_from", ["hemisphere", "sphere"])
@pytest.mark.parametrize("split", SPLITS)
def test_every_camera_is_rigid_looks_at_the_origin_and_has_no_roll(split: str, view_from: str) -> None:
    poses = all_poses(split, view_from)
    assert len(poses) == {"train": 100, "val": 100, "test": 200}[split]
    rotation, position = poses[:, :3, :3], poses[:, :3, 3]
    assert np.abs(np.einsum("nij,nik->njk", rotation, rotation) - np.eye(3)).max() < 1e-12
    assert np.allclose(np.linalg.det(rotation), 1)
    assert np.allclose(np.linalg.norm(position, axis=1), np.sqrt(4**2 + 0.5**2))
    # the backward axis points away from the origin
    assert np.allclose(rotation[:, :, 2], position / 4.0311288741, atol=1e-9)
    assert np.abs(rotation[:, 2, 0]).max() < 1e-12  # right axis is horizontal
    assert (rotation[:, 2, 1] >= 0).all()  # up axis points up


@pytest.mark.parametrize("split", ["train", "val"])
def test_random_views_cover_the_upper_hemisphere_evenly(split: str) -> None:
    poses = all_poses(split)
    elevation = elevation_of(poses)
    assert elevation.min() >= TILT - 1e-12
    # |arcsin U| turned up by 7.125° and folded at the pole: the sine of it is uniform in the mean
    draws = np.abs(np.arcsin(np.random.default_rng(1).uniform(-1, 1, 200_000))) + TILT
    expected = np.sort(np.minimum(draws, np.pi - draws))
    cumulative = np.searchsorted(expected, np.sort(elevation)) / len(expected)
    assert np.abs(cumulative - np.arange(1, 101) / 100).max() < 1.63 / 10  # Kolmogorov–Smirnov, 1 %
    assert np.abs(np.sort(azimuth_of(poses)) / 360 - np.arange(1, 101) / 100).max() < 1.63 / 10


def test_the_sphere_is_seen_from_below_too() -> None:
    elevation = elevation_of(all_poses("train", "sphere"))
    assert (elevation < 0).sum() > 30
    assert (elevation > 0).sum() > 30


def test_the_spiral_is_the_published_one() -> None:
    """Frames 0 and 1 of lego's transforms_test.json, as the data set has them."""
    poses = all_poses("test")
    assert poses[0, :3] == pytest.approx(
        np.array(
            [[-1, 0, 0, 0], [0, -0.7341099977, 0.6790305972, 2.737260103], [0, 0.6790306, 0.7341099977, 2.959291935]]
        ),
        abs=2e-6,
    )
    assert poses[1, 0] == pytest.approx([-0.9980267286, 0.0460951477, -0.0426366888, -0.1718739867], abs=2e-6)
    k = np.arange(200)
    assert elevation_of(poses) == pytest.approx(TILT + 0.35 * (1 + np.cos(2 * np.pi * np.maximum(k - 1, 0) / 200)))
    steps = np.diff(azimuth_of(poses)) % 360
    assert steps == pytest.approx(3.6)
    assert np.array_equal(poses, all_poses("test", "sphere"))


@given(st.integers(1, 100))
def test_test_subsets_have_as_many_azimuths_as_views(count: int) -> None:
    chosen = evenly_spread(count, all_poses("test"))
    assert len(np.unique(chosen)) == count
    azimuth = np.sort(azimuth_of(all_poses("test"))[chosen])
    gaps = np.diff(np.append(azimuth, azimuth[0] + 360))
    assert gaps.min() > 3.5  # distinct
    assert gaps.max() < 360 / count + 3.7  # and evenly spread


@pytest.mark.parametrize("count", [-1, 101])
def test_an_invalid_count_is_refused(count: int) -> None:
    with pytest.raises(InputError, match="100"):
        camera_to_world("train", count=count)


@pytest.mark.parametrize(
    ("name", "damage"),
    [
        ("NaN", lambda m: m.__setitem__((0, 0), np.nan)),
        ("infinity", lambda m: m.__setitem__((0, 3), np.inf)),
        ("rotation", lambda m: m.__setitem__((slice(0, 3), 0), -m[:3, 0])),
        ("last row", lambda m: m.__setitem__((3, 0), 1)),
        ("single precision", lambda m: m.__setitem__((0, 3), 1e7)),
    ],
)
def test_degenerate_poses_are_refused_by_name(name: str, damage: object) -> None:
    poses = poses_on_sphere(np.array([0.3, 0.3]), np.array([0.4, 0.4]))
    check_poses(poses, ["view 6", "view 7"])
    damage(poses[1])  # type: ignore[operator]
    with pytest.raises(InputError, match=f"view 7.*{name}"):
        check_poses(poses, ["view 6", "view 7"])


def test_a_camera_straight_above_has_a_direction_for_up() -> None:
    check_poses(poses_on_sphere(np.zeros(2), np.array([np.pi / 2, -np.pi / 2])), ["above", "below"])


@given(st.floats(0, 6.28), st.floats(-1.5, 1.5), st.floats(0.01, 100))
def test_looking_at_the_origin_is_standing_on_the_sphere(azimuth: float, elevation: float, radius: float) -> None:
    pose = poses_on_sphere(np.array([azimuth]), np.array([elevation]), radius)[0]
    assert look_at(pose[:3, 3], np.zeros(3)) == pytest.approx(pose, abs=1e-9 * max(radius, 1))
    check_poses(look_at(pose[:3, 3], np.array([0.3, -0.2, 0.1]))[None], ["view"])


@pytest.mark.parametrize(
    ("origin", "target", "up", "message"),
    [
        ([1e5, 0, 0], [1e5, 1e-6, 0], [0, 0, 1], "stands on its target"),
        ([0, 0, 4], [0, 0, 0], [1e-9, 0, -3], "lies along the view"),
        ([4, 0, np.nan], [0, 0, 0], [0, 0, 1], "origin"),
        ([4, 0, 0], [0, np.inf, 0], [0, 0, 1], "target"),
        ([4, 0, 0], [0, 0, 0], [0, 1], "up"),
    ],
)
def test_undefined_views_are_refused(origin: list[float], target: list[float], up: list[float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        look_at(np.array(origin), np.array(target), np.array(up))


def test_repeated_views_are_found_for_any_sign_of_zero() -> None:
    poses = all_poses("test")[[3, 9, 3, 4, 9]].copy()
    poses[2][np.abs(poses[2]) < 1e-12] = -0.0
    assert repeated(poses) == [(0, 2), (1, 4)]
    assert repeated(all_poses("train")) == []
