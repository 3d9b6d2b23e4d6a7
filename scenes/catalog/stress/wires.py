"""Straight black wires, thinner than a pixel: a pixel shows the share of it that they cover."""

import math
from itertools import pairwise

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import BLACK, sky
from scenes.modelling.scene import Description, Scene
from scenes.modelling.truth import Seen, Truth
from scenes.view_sets.viewpoints import FOV_X_RADIANS, RADIUS

RESOLUTION = 48
"""The width in pixels of the views that the stress scenes are meant for."""
QUARTER_PIXEL = 0.25
HALF = 0.75
"""Half an edge of the cage."""


def pixel_size(resolution: int) -> float:
    """Return the width of a pixel's footprint at the origin, scene units."""
    return 2 * math.tan(0.5 * FOV_X_RADIANS) * RADIUS / resolution


def spans() -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the ends of the wires: a cube's twelve edges and its four long diagonals."""
    ring = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]
    edges = [((*a, z), (*b, z)) for z in (-1, 1) for a, b in pairwise(ring)]
    posts = [((*a, -1), (*a, 1)) for a in ring[:4]]
    diagonals = [((*a, -1), (-a[0], -a[1], 1)) for a in ring[:4]]
    return [(HALF * np.array(a, float), HALF * np.array(b, float)) for a, b in edges + posts + diagonals]


def wires(name: str, title: str, width: float) -> Scene:
    """Make wires of that width in scene units."""

    def build() -> Description:
        shapes = {
            f"wire_{number}": {
                "type": "cylinder", "p0": a.tolist(), "p1": b.tolist(), "radius": width / 2, "bsdf": BLACK,
            }
            for number, (a, b) in enumerate(spans())
        }  # fmt: skip
        return {"sky": sky(), **shapes}

    return Scene(name=name, title=title, build=build, truth=wires_truth(width))


def wires_truth(width: float) -> Truth:
    def truth(o: np.ndarray, d: np.ndarray) -> Seen:
        t = np.min([geometry.tube(o, d, a, b, width / 2) for a, b in spans()], axis=0)
        hit = np.isfinite(t)
        return Seen(np.zeros(o.shape), hit.astype(float), np.where(hit, t, 0.0))

    return truth


SCENES = {
    "wires": wires(
        "wires",
        f"A cage of wires a quarter of a pixel thin at {RESOLUTION} pixels: rays through pixel centres miss them",
        QUARTER_PIXEL * pixel_size(RESOLUTION),
    )
}
