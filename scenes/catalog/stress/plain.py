"""An empty scene, a black and a white ball, and a wall: balls that glow by themselves, whose images have no noise but
at their borders.
"""

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import BLACK, fields, glow, patchwork, rgb, sky
from scenes.modelling.scene import Description, Scene
from scenes.modelling.truth import Seen, Truth

RADIUS = 0.9
WALL_RADIUS = 2.4
"""The radius of the wall: seen from 4.03, a ball of more than 1.83 fills a view up to its corners."""


def nothing(o: np.ndarray, d: np.ndarray) -> Seen:
    return Seen(np.zeros(o.shape), np.zeros(len(o)), np.zeros(len(o)))


def textured_ball(pixels: np.ndarray, radius: float = RADIUS) -> tuple[Description, Truth]:
    """Return a ball of that radiance [h, w, 3], for a scene with `emitters_seen`, and what its rays see."""

    def truth(o: np.ndarray, d: np.ndarray) -> Seen:
        t = geometry.first_ball(o, d, (0.0, 0.0, 0.0), radius)
        hit = np.isfinite(t)
        radiance = geometry.ball_texture(pixels, geometry.at(o, d, t) / radius)
        return Seen(np.where(hit[:, None], radiance, 0.0), hit.astype(float), np.where(hit, t, 0.0))

    even = bool((pixels == pixels[0, 0]).all())
    radiance = rgb(*(float(value) for value in pixels[0, 0])) if even else fields(pixels)
    return {"ball": {"type": "sphere", "radius": radius, "bsdf": BLACK, "emitter": glow(radiance)}}, truth


def one_colour(value: float) -> np.ndarray:
    return np.full((1, 1, 3), value, dtype=np.float32)


def wall_pixels() -> np.ndarray:
    return patchwork(17, 18, 36)


def empty() -> Description:
    return {"sky": sky()}


def black() -> Description:
    return {"sky": sky(), "ball": {"type": "sphere", "radius": RADIUS, "bsdf": BLACK}}


def white() -> Description:
    return textured_ball(one_colour(1.0))[0]


def wall() -> Description:
    return textured_ball(wall_pixels(), WALL_RADIUS)[0]


SCENES = {
    "empty": Scene(
        name="empty",
        title="Nothing at all: every pixel is background, and there is no signal to learn from",
        build=empty,
        box=((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)),
        truth=nothing,
    ),
    "black": Scene(
        name="black",
        title="A ball that reflects nothing: a silhouette without any shading",
        build=black,
        truth=textured_ball(one_colour(0.0))[1],
    ),
    "white": Scene(
        name="white",
        title="A ball that glows white: over white it cannot be seen, its alpha alone tells",
        build=white,
        emitters_seen=True,
        truth=textured_ball(one_colour(1.0))[1],
    ),
    "wall": Scene(
        name="wall",
        title="An opaque ball so close that it fills every view: no background, near surfaces",
        build=wall,
        near=1.0,
        emitters_seen=True,
        truth=textured_ball(wall_pixels(), WALL_RADIUS)[1],
    ),
}
