"""Scenes of one shape: nothing at all, balls that are black, white or fill the view, and rooms seen from inside.

Most glow by themselves, so that their images have no noise but at their borders.
"""

from dataclasses import replace

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import BLACK, fields, glowing, patchwork, rgb, sky
from scenes.modelling.scene import Description, Scene
from scenes.modelling.surfaces import matte
from scenes.modelling.truth import Seen

RADIUS = 0.9
WALL_RADIUS = 2.4
"""The radius of the wall: seen from 4.03, a ball of more than 1.83 fills a view up to its corners."""
ROOM_RADIUS = 5.0
"""The radius of the hollow ball. Cameras stand 4.03 from the centre, which they look at: they see the wall behind."""
ROOM_PIXELS = patchwork(23, 12, 24)
HALF = 4.5
"""Half an edge of the furnace, a cube: from inside a glowing *ball*, Mitsuba 3.9.1 samples light that is too bright,
by 0.2 % at radius 5 and 2.6 % at radius 50 (measured; for the cube by less than 1e-4)."""
EMISSION, ALBEDO = (0.40, 0.26, 0.20), (0.20, 0.35, 0.50)
FURNACE_RADIANCE = tuple(emission / (1.0 - albedo) for emission, albedo in zip(EMISSION, ALBEDO, strict=True))
"""The radiance E / (1 − ρ), everywhere and in every direction: the sum of a geometric series of bounces."""
FURNACE_DEPTH = 24
"""The longest path: 0.5^24 = 6e-8 of the light is lost to paths that are cut off."""


def nothing(o: np.ndarray, d: np.ndarray) -> Seen:
    return Seen(np.zeros(o.shape), np.zeros(len(o)), np.zeros(len(o)))


def textured_ball(name: str, title: str, pixels: np.ndarray, radius: float = RADIUS, near: float = 2.0) -> Scene:
    """Make a ball of that radiance [h, w, 3]."""

    def build() -> Description:
        even = bool((pixels == pixels[0, 0]).all())
        radiance = rgb(*(float(value) for value in pixels[0, 0])) if even else fields(pixels)
        return {"ball": {"type": "sphere", "radius": radius, **glowing(radiance)}}

    def truth(o: np.ndarray, d: np.ndarray) -> Seen:
        t = geometry.first_ball(o, d, geometry.ORIGIN, radius)
        return Seen.at(t, geometry.ball_texture(pixels, geometry.at(o, d, t) / radius))

    return Scene(name, title, build, near=near, emitters_seen=True, truth=truth)


def one_colour(value: float) -> np.ndarray:
    return np.full((1, 1, 3), value, dtype=np.float32)


def inside() -> Description:
    return {"room": {"type": "sphere", "radius": ROOM_RADIUS, "flip_normals": True, **glowing(fields(ROOM_PIXELS))}}


def inside_truth(o: np.ndarray, d: np.ndarray) -> Seen:
    _, t = geometry.ball(o, d, geometry.ORIGIN, ROOM_RADIUS)
    return Seen(geometry.ball_texture(ROOM_PIXELS, (o + t[:, None] * d) / ROOM_RADIUS), np.ones(len(o)), t)


def furnace() -> Description:
    cube = {"type": "cube", "to_world": np.diag([HALF, HALF, HALF, 1.0]), "flip_normals": True}
    return {"room": {**cube, **glowing(rgb(*EMISSION)), "bsdf": matte(rgb(*ALBEDO))}}


def furnace_truth(o: np.ndarray, d: np.ndarray) -> Seen:
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(d == 0, np.inf, (np.sign(d) * HALF - o) / d).min(axis=-1)
    return Seen(np.broadcast_to(np.array(FURNACE_RADIANCE), o.shape).copy(), np.ones(len(o)), t)


SCENES = [
    Scene(
        "empty", "Nothing at all: every pixel is background, and there is no signal to learn from",
        lambda: {"sky": sky()}, box=((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)),
        truth=nothing,
    ),
    replace(
        textured_ball("black", "A ball that reflects nothing: a silhouette without any shading", one_colour(0.0)),
        build=lambda: {"sky": sky(), "ball": {"type": "sphere", "radius": RADIUS, "bsdf": BLACK}}, emitters_seen=False,
    ),
    textured_ball("white", "A ball that glows white: over white it cannot be seen, its alpha alone tells",
                  one_colour(1.0)),
    textured_ball("wall", "An opaque ball so close that it fills every view: no background, near surfaces",
                  patchwork(17, 18, 36), WALL_RADIUS, near=1.0),
    Scene(
        "inside", "Cameras inside a hollow ball with glowing walls: no background, and all distances long",
        inside, far=10.0, emitters_seen=True, truth=inside_truth,
    ),
    Scene(
        "furnace", "A closed furnace: the same radiance E / (1 − ρ) from every point in every direction",
        furnace, far=13.0, max_depth=FURNACE_DEPTH, emitters_seen=True, truth=furnace_truth,
    ),
]  # fmt: skip
