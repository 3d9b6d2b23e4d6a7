"""Camera paths, frame by frame: float64 [frames, 4, 4], OpenGL axes, z up and no roll (`CONVENTIONS.md`).

The cameras lie on a sphere about the origin and look at it, as those of a view set do; angles are in radians.
"""

import math
from collections.abc import Callable

import numpy as np

from scenes.files.errors import InputError
from scenes.view_sets.viewpoints import RADIUS, TILT, VIEW_COUNTS, poses_on_sphere

ELEVATION = math.radians(30.0)
QUARTER = 0.5 * math.pi
"""The azimuth of the first test view."""
TURN_STEPS = 60
"""The steps of a walk around a full circle."""
KEEP = 0.75
"""The probability with which a walk keeps its direction."""


def orbit(frames: int, radius: float = RADIUS, elevation: float = ELEVATION) -> np.ndarray:
    """Make one turn at constant height, counterclockwise seen from above, after whose last frame the first follows."""
    turns = QUARTER + 2.0 * math.pi * np.arange(frames) / frames
    return _on_sphere(turns, np.full(frames, float(elevation)), radius)


def spiral(frames: int = VIEW_COUNTS["test"], radius: float = RADIUS) -> np.ndarray:
    """Follow the test spiral of the NeRF synthetic set: two turns while the camera goes down and up again. With 200
    frames these are the test views of `scenes.view_sets.viewpoints`; otherwise the same curve in equal steps.
    """
    count = VIEW_COUNTS["test"]
    k = np.arange(frames) * (count / frames)
    azimuth = np.pi / 2 + np.radians(3.6) * k
    elevation = TILT + 0.35 * (1 + np.cos(2 * np.pi * np.maximum(k - 1, 0) / count))
    return _on_sphere(azimuth, elevation, radius)


def walk(frames: int, seed: int = 0, radius: float = RADIUS) -> np.ndarray:
    """Walk at random: one step per frame to the left, right, up or down, mostly in the same direction as before. Steps
    are 6° on a lattice between the lowest and the highest elevation of the spiral, so that a revisited place has
    bit-identical poses.
    """
    generator = np.random.default_rng(seed)
    step = 2.0 * math.pi / TURN_STEPS
    rows = math.floor(0.7 / step) + 1
    ways = ((1, 0), (-1, 0), (0, 1), (0, -1))
    column, row, way = 0, rows // 2, 0
    places = []
    for _ in range(frames):
        places.append((column, row))
        if generator.random() >= KEEP:
            way = int(generator.integers(len(ways)))
        if not 0 <= row + ways[way][1] < rows:
            way ^= 1  # turn back at the bottom and the top
        column, row = (column + ways[way][0]) % TURN_STEPS, row + ways[way][1]
    lattice = np.array(places, dtype=np.float64)
    return _on_sphere(QUARTER + step * lattice[:, 0], TILT + step * lattice[:, 1], radius)


PATHS: dict[str, Callable[..., np.ndarray]] = {"orbit": orbit, "spiral": spiral, "walk": walk}
"""The paths, called as `PATHS[name](frames, radius=…)`."""


def _on_sphere(azimuth: np.ndarray, elevation: np.ndarray, radius: float) -> np.ndarray:
    if not (math.isfinite(radius) and radius > 0.0):
        raise InputError(f"radius {radius}: must be a positive number of scene units")
    return poses_on_sphere(azimuth, elevation, radius)
