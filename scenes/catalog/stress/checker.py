"""A chequered square whose fields are one pixel wide at 48 pixels: the Nyquist limit, and beyond where it recedes."""

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import chequers, diffuse, fields, level, sky
from scenes.catalog.stress.wires import RESOLUTION, pixel_size
from scenes.modelling.scene import Description, Scene
from scenes.modelling.truth import Seen

HALF = 0.95
FIELDS = round(2 * HALF / pixel_size(RESOLUTION))
"""The number of fields along a side."""


def pixels() -> np.ndarray:
    return chequers(FIELDS, FIELDS, (0.95, 0.90, 0.80), (0.05, 0.10, 0.20))


def build() -> Description:
    floor = {"type": "rectangle", "to_world": level(HALF, 0.0), "bsdf": diffuse(fields(pixels()))}
    return {"sky": sky(), "floor": floor}


def truth(o: np.ndarray, d: np.ndarray) -> Seen:
    """Return what rays see from above."""
    t = geometry.square(o, d, 0.0, HALF)
    hit = np.isfinite(t)
    albedo = geometry.square_texture(pixels(), geometry.at(o, d, t), HALF)
    return Seen(np.where(hit[:, None], albedo, 0.0), hit.astype(float), np.where(hit, t, 0.0))


SCENES = {
    "checker": Scene(
        name="checker",
        title=f"Chequers one pixel wide at {RESOLUTION} pixels: at the Nyquist limit, and beyond it at the back",
        build=build,
        truth=truth,
    )
}
