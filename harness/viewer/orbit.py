"""Cameras that circle a point, z up. Angles in radians, lengths in scene units."""

import math
from dataclasses import dataclass, replace

import numpy as np

from harness.camera import Camera
from scenes.viewpoints import poses_on_sphere

STEEPEST = math.radians(89.9)
"""Right above its target a camera has no upright."""
MARGIN = 1e-3
"""Of the box's half diagonal, kept free before and behind it."""


@dataclass(frozen=True)
class Orbit:
    """Where a camera stands that looks at `target`, without roll.

    Raises `ValueError` for a number that is not finite, and for a distance that is not positive.
    """

    target: tuple[float, float, float]
    azimuth: float
    """Counterclockwise from x, seen from above."""
    elevation: float
    distance: float

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.target, self.azimuth, self.elevation, self.distance))):
            raise ValueError("a camera is given by finite numbers")
        if self.distance <= 0.0:
            raise ValueError(f"distance {self.distance}: a camera stands away from what it looks at")

    def pose(self) -> np.ndarray:
        """Camera to world [4, 4], OpenGL axes; elevations beyond the poles are taken to be just below them."""
        elevation = min(max(self.elevation, -STEEPEST), STEEPEST)
        pose = poses_on_sphere(np.array([self.azimuth]), np.array([elevation]), self.distance)[0]
        pose[:3, 3] += self.target
        return pose


def orbit_of(camera_to_world: np.ndarray, centre: np.ndarray) -> Orbit:
    """The orbit that goes on from a pose without a jump: about the point of its optical axis next to `centre` [3].

    Roll is not part of an orbit. A camera that looks away from `centre` gets a target as far before it.
    """
    eye, backward = camera_to_world[:3, 3], camera_to_world[:3, 2] / np.linalg.norm(camera_to_world[:3, 2])
    away = float(np.linalg.norm(eye - centre))
    along = float(backward @ (eye - centre))
    distance = along if along > 0.1 * away else max(away, 1e-3)
    x, y, z = (eye - distance * backward).tolist()
    flat = math.hypot(backward[0], backward[1])
    return Orbit((x, y, z), math.atan2(backward[1], backward[0]), math.atan2(float(backward[2]), flat), distance)


def covering(camera: Camera, bounds: np.ndarray) -> Camera:
    """The same camera with near and far moved apart, where they must be, until they hold the whole box [2, 3]."""
    lower, upper = np.asarray(bounds, dtype=np.float64)
    radius = (1.0 + MARGIN) * 0.5 * float(np.linalg.norm(upper - lower))
    distance = float(np.linalg.norm(camera.camera_to_world[:3, 3] - 0.5 * (lower + upper)))
    near, far = max(0.0, distance - radius), distance + radius
    if camera.near <= near and far <= camera.far:
        return camera
    return replace(camera, near=min(camera.near, near), far=max(camera.far, far))
