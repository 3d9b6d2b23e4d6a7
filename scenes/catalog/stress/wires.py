"""Detail of about a pixel: straight black wires, which cover a share of a pixel, and a chequered square whose fields
are one pixel wide at 48 pixels: at the Nyquist limit, and beyond it where the square recedes.
"""

import math
from itertools import pairwise

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import BLACK, chequers, fields, floor, sky
from scenes.modelling.scene import Description, Scene
from scenes.modelling.surfaces import matte
from scenes.modelling.truth import Seen, Truth
from scenes.view_sets.viewpoints import FOV_X_RADIANS, RADIUS

RESOLUTION = 48
"""The width in pixels of the views that the stress scenes are meant for."""
CAGE_HALF, FLOOR_HALF = 0.75, 0.95


def pixel_size(resolution: int) -> float:
    """Return the width of a pixel's footprint at the origin, scene units."""
    return 2 * math.tan(0.5 * FOV_X_RADIANS) * RADIUS / resolution


FIELDS = round(2 * FLOOR_HALF / pixel_size(RESOLUTION))
CHEQUERS = chequers(FIELDS, FIELDS, (0.95, 0.90, 0.80), (0.05, 0.10, 0.20))


def spans() -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the ends of the wires: a cube's twelve edges and its four long diagonals."""
    ring = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]
    edges = [((*a, z), (*b, z)) for z in (-1, 1) for a, b in pairwise(ring)]
    posts = [((*a, -1), (*a, 1)) for a in ring[:4]]
    diagonals = [((*a, -1), (-a[0], -a[1], 1)) for a in ring[:4]]
    return [(CAGE_HALF * np.array(a, float), CAGE_HALF * np.array(b, float)) for a, b in edges + posts + diagonals]


def wires(name: str, title: str, width: float) -> Scene:
    """Make wires of that width in scene units."""

    def build() -> Description:
        shapes = {
            f"wire_{i}": {"type": "cylinder", "p0": a.tolist(), "p1": b.tolist(), "radius": width / 2, "bsdf": BLACK}
            for i, (a, b) in enumerate(spans())
        }
        return {"sky": sky(), **shapes}

    return Scene(name, title, build, truth=wires_truth(width))


def wires_truth(width: float) -> Truth:
    def truth(o: np.ndarray, d: np.ndarray) -> Seen:
        t = np.min([geometry.tube(o, d, a, b, width / 2) for a, b in spans()], axis=0)
        return Seen.at(t, np.zeros(o.shape))

    return truth


def checker_truth(o: np.ndarray, d: np.ndarray) -> Seen:
    t = geometry.square(o, d, 0.0, FLOOR_HALF)
    return Seen.at(t, geometry.square_texture(CHEQUERS, geometry.at(o, d, t), FLOOR_HALF))


SCENES = [
    wires(
        "wires",
        f"A cage of wires a quarter of a pixel thin at {RESOLUTION} pixels: rays through pixel centres miss them",
        0.25 * pixel_size(RESOLUTION),
    ),
    Scene(
        "checker",
        f"Chequers one pixel wide at {RESOLUTION} pixels: at the Nyquist limit, and beyond it at the back",
        lambda: {"sky": sky(), "floor": floor(FLOOR_HALF, 0.0, bsdf=matte(fields(CHEQUERS)))},
        truth=checker_truth,
    ),
]
