"""Camera paths: rigid, level, on their sphere, with the documented steps."""

import math

import numpy as np
import pytest

from harness.playback.camera_paths import PATHS, orbit, spiral, walk
from scenes.files.errors import InputError
from scenes.view_sets.viewpoints import RADIUS, TILT, all_poses


def assert_level_and_rigid(poses: np.ndarray) -> None:
    assert poses.dtype == np.float64
    assert poses.shape[1:] == (4, 4)
    rotation = poses[:, :3, :3]
    np.testing.assert_allclose(rotation.transpose(0, 2, 1) @ rotation, len(poses) * [np.eye(3)], atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0, atol=1e-14)
    np.testing.assert_array_equal(poses[:, 3], len(poses) * [[0.0, 0.0, 0.0, 1.0]])
    np.testing.assert_allclose(rotation[:, 2, 0], 0.0, atol=1e-14)
    assert (rotation[:, 2, 1] >= -1e-14).all(), "up points up"


@pytest.mark.parametrize("name", PATHS)
def test_every_path_is_level_and_looks_at_the_origin_from_its_radius(name: str) -> None:
    poses = PATHS[name](23, radius=2.5)
    assert len(poses) == 23
    assert_level_and_rigid(poses)
    np.testing.assert_allclose(poses[:, :3, 3], 2.5 * poses[:, :3, 2], atol=1e-14)
    np.testing.assert_array_equal(poses, PATHS[name](23, radius=2.5))


def test_an_orbit_is_closed_in_equal_steps_at_one_height() -> None:
    frames, elevation = 12, 0.4
    poses = orbit(frames, 3.0, elevation)
    turn = poses @ np.linalg.inv(np.roll(poses, 1, axis=0))  # the last one to the first included
    cosine, sine = math.cos(2 * math.pi / frames), math.sin(2 * math.pi / frames)
    np.testing.assert_allclose(turn[:, :2, :2], frames * [[[cosine, -sine], [sine, cosine]]], atol=1e-14)
    np.testing.assert_allclose(poses[:, 2, 3], 3.0 * math.sin(elevation))
    assert math.atan2(poses[0, 1, 3], poses[0, 0, 3]) == pytest.approx(0.5 * math.pi)


@pytest.mark.parametrize("elevation", [math.pi / 2, -math.pi / 2])
def test_an_orbit_over_a_pole_turns_the_picture(elevation: float) -> None:
    poses = orbit(4, elevation=elevation)
    assert_level_and_rigid(poses)
    np.testing.assert_allclose(poses[:, :3, 3], 4 * [[0.0, 0.0, math.copysign(RADIUS, elevation)]], atol=1e-14)
    np.testing.assert_allclose(poses[0, :3, 0], -poses[2, :3, 0], atol=1e-14)


def test_the_spiral_is_the_test_views_to_the_last_bit() -> None:
    np.testing.assert_array_equal(spiral(), all_poses("test"))
    np.testing.assert_array_equal(spiral(200), all_poses("test"))
    np.testing.assert_allclose(spiral(100), all_poses("test")[::2], atol=1e-14)


def test_a_walk_goes_step_by_step_and_comes_back_to_the_same_bits() -> None:
    poses = walk(400, seed=3)
    height = np.arcsin(poses[:, 2, 3] / RADIUS)
    azimuth = np.unwrap(np.arctan2(poses[:, 1, 3], poses[:, 0, 3]))
    steps = np.stack([np.diff(azimuth), np.diff(height)]) / math.radians(6.0)
    np.testing.assert_allclose(np.abs(steps).sum(axis=0), 1.0, atol=1e-9)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert height.min() >= TILT - 1e-12
    assert height.max() <= TILT + 0.7 + 1e-12
    places = {tuple(np.round(pose[:3, 3], 9)) for pose in poses}
    assert len(places) == len({pose.tobytes() for pose in poses}) < 300
    for column in (0, 1):
        assert {-1, 0, 1} == set(np.round(steps[column]).astype(int)), "to and fro both ways"
    assert not np.array_equal(walk(50, seed=3), walk(50, seed=4))
    np.testing.assert_array_equal(walk(50, seed=3), poses[:50])


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan, math.inf])
def test_an_impossible_radius_is_refused(name: str, radius: float) -> None:
    with pytest.raises(InputError, match=f"radius {radius}"):
        PATHS[name](2, radius=radius)
