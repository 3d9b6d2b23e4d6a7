"""Inside of things: a hollow ball that glows, and a closed furnace, whose radiance is the same everywhere."""

import numpy as np

from scenes.scene import Description, Scene
from scenes.stress import geometry
from scenes.stress.patterns import BLACK, diffuse, fields, glow, patchwork, rgb
from scenes.truth import Seen

RADIUS = 5.0
"""Cameras stand 4.03 from the centre, which they look at: they see the wall behind it."""
EMISSION = (0.30, 0.20, 0.10)
ALBEDO = (0.20, 0.50, 0.80)
FURNACE_RADIANCE = tuple(emission / (1.0 - albedo) for emission, albedo in zip(EMISSION, ALBEDO, strict=True))
"""E / (1 − ρ), everywhere and in every direction: the sum of a geometric series of bounces."""
FURNACE_DEPTH = 64
"""0.8^64 = 6e-7 of the light is lost to paths that are cut off."""


def wall_pixels() -> np.ndarray:
    return patchwork(23, 12, 24)


def hollow(matter: Description, radiance: Description) -> Description:
    """A ball seen from inside, that glows inwards."""
    ball = {"type": "sphere", "radius": RADIUS, "flip_normals": True, "bsdf": matter, "emitter": glow(radiance)}
    return {"room": ball}


def inside() -> Description:
    return hollow(BLACK, fields(wall_pixels()))


def furnace() -> Description:
    return hollow(diffuse(rgb(*ALBEDO)), rgb(*EMISSION))


def inside_truth(o: np.ndarray, d: np.ndarray) -> Seen:
    """For origins inside of the room."""
    _, t = geometry.ball(o, d, (0.0, 0.0, 0.0), RADIUS)
    return Seen(geometry.ball_texture(wall_pixels(), (o + t[:, None] * d) / RADIUS), np.ones(len(o)), t)


def furnace_truth(o: np.ndarray, d: np.ndarray) -> Seen:
    """For origins inside of the room."""
    _, t = geometry.ball(o, d, (0.0, 0.0, 0.0), RADIUS)
    return Seen(np.broadcast_to(np.array(FURNACE_RADIANCE), o.shape).copy(), np.ones(len(o)), t)


SCENES = {
    "inside": Scene(
        name="inside",
        title="Cameras inside a hollow ball with glowing walls: no background, and all distances long",
        build=inside,
        far=10.0,
        emitters_seen=True,
        truth=inside_truth,
    ),
    "furnace": Scene(
        name="furnace",
        title="A closed furnace: the same radiance E / (1 − ρ) from every point in every direction",
        build=furnace,
        far=10.0,
        max_depth=FURNACE_DEPTH,
        emitters_seen=True,
        truth=furnace_truth,
    ),
}
