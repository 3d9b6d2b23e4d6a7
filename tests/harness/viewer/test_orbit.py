"""Orbits as poses, and poses as orbits."""

import math

import numpy as np
import pytest

from harness.training.batches import Camera
from harness.viewer.requests import STEEPEST, Orbit, covering, orbit_of
from scenes.view_sets.viewpoints import look_at
from tests.harness.ball import pose

CENTRE = np.array([0.3, -0.2, 0.1])
BOUNDS = np.array([[-1.0, -1.0, -0.5], [1.0, 1.0, 0.5]])


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 0.0), (1.3, 0.7), (-2.5, -1.2), (3.0, 1.5)])
def test_an_orbit_looks_at_its_target_upright(azimuth: float, elevation: float) -> None:
    camera_pose = Orbit((0.3, -0.2, 0.1), azimuth, elevation, 2.5).pose()
    np.testing.assert_allclose(camera_pose, look_at(camera_pose[:3, 3], CENTRE), atol=1e-12)
    assert np.linalg.norm(camera_pose[:3, 3] - CENTRE) == pytest.approx(2.5)
    assert camera_pose[2, 0] == pytest.approx(0.0, abs=1e-15)  # right is level
    assert camera_pose[2, 1] > 0.0  # and up is up
    assert camera_pose[2, 3] - CENTRE[2] == pytest.approx(2.5 * math.sin(elevation))


@pytest.mark.parametrize("elevation", [math.pi / 2, 10.0, -math.pi / 2, -10.0])
def test_beyond_the_pole_it_stays_just_below(elevation: float) -> None:
    camera_pose = Orbit((0.0, 0.0, 0.0), 0.5, elevation, 4.0).pose()
    steepest = Orbit((0.0, 0.0, 0.0), 0.5, math.copysign(STEEPEST, elevation), 4.0).pose()
    assert np.array_equal(camera_pose, steepest)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.4, 0.2), (2.0, 1.0), (-1.0, -0.3), (-3.1, 1.4)])
def test_from_a_pose_one_goes_on_without_a_jump(azimuth: float, elevation: float) -> None:
    """The views look at the origin, and the centre of the box lies elsewhere."""
    given = pose(azimuth, elevation)
    orbit = orbit_of(given, CENTRE)
    np.testing.assert_allclose(orbit.pose(), given, atol=1e-12)
    to_axis = np.linalg.norm(np.cross(given[:3, 2], CENTRE - given[:3, 3]))
    assert np.linalg.norm(np.array(orbit.target) - CENTRE) == pytest.approx(to_axis)


def test_a_camera_that_looks_away_gets_a_target_before_it() -> None:
    away = pose(0.4, 0.2)
    away[:3, [0, 2]] *= -1.0
    orbit = orbit_of(away, np.zeros(3))
    np.testing.assert_allclose(orbit.pose(), away, atol=1e-12)
    assert orbit.distance == pytest.approx(4.0311)


@pytest.mark.parametrize("distance", [0.2, 1.0, 4.0, 7.0, 50.0])
def test_near_and_far_hold_the_whole_box(distance: float) -> None:
    camera = Camera(Orbit((0.0, 0.0, 0.0), 0.3, 0.4, distance).pose(), 8, 8, 10.0, 2.0, 6.0)
    wider = covering(camera, BOUNDS)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-0.5, 0.5)])
    lengths = np.linalg.norm(corners - camera.camera_to_world[:3, 3], axis=-1)
    inside = bool((np.abs(camera.camera_to_world[:3, 3]) < BOUNDS[1]).all())
    assert wider.near <= (0.0 if inside else lengths.min())
    assert wider.far >= lengths.max()
    assert (wider is camera) == (distance == 4.0)
    assert wider.near <= 2.0
    assert wider.far >= 6.0
