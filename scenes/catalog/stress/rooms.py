"""Views from inside: a hollow ball that glows, and a closed furnace, whose radiance is the same everywhere."""

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import BLACK, diffuse, fields, glow, patchwork, rgb
from scenes.modelling.scene import Description, Scene
from scenes.modelling.truth import Seen

RADIUS = 5.0
"""The radius of the ball. Cameras stand 4.03 from the centre, which they look at: they see the wall behind it."""
HALF = 4.5
"""Half an edge of the furnace, a cube: from inside a glowing *ball*, Mitsuba 3.9.1 samples light that is too bright,
by 0.2 % at radius 5 and 2.6 % at radius 50 (measured; for the cube by less than 1e-4)."""
EMISSION = (0.40, 0.26, 0.20)
ALBEDO = (0.20, 0.35, 0.50)
FURNACE_RADIANCE = tuple(emission / (1.0 - albedo) for emission, albedo in zip(EMISSION, ALBEDO, strict=True))
"""The radiance E / (1 − ρ), everywhere and in every direction: the sum of a geometric series of bounces."""
FURNACE_DEPTH = 24
"""The longest path: 0.5^24 = 6e-8 of the light is lost to paths that are cut off."""


def wall_pixels() -> np.ndarray:
    return patchwork(23, 12, 24)


def inside() -> Description:
    ball = {"type": "sphere", "radius": RADIUS, "flip_normals": True, "bsdf": BLACK,
            "emitter": glow(fields(wall_pixels()))}  # fmt: skip
    return {"room": ball}


def furnace() -> Description:
    cube = {"type": "cube", "to_world": np.diag([HALF, HALF, HALF, 1.0]), "flip_normals": True,
            "bsdf": diffuse(rgb(*ALBEDO)), "emitter": glow(rgb(*EMISSION))}  # fmt: skip
    return {"room": cube}


def inside_truth(o: np.ndarray, d: np.ndarray) -> Seen:
    """Return what rays see that start inside the hollow ball."""
    _, t = geometry.ball(o, d, (0.0, 0.0, 0.0), RADIUS)
    return Seen(geometry.ball_texture(wall_pixels(), (o + t[:, None] * d) / RADIUS), np.ones(len(o)), t)


def furnace_truth(o: np.ndarray, d: np.ndarray) -> Seen:
    """Return what rays see that start inside the furnace."""
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(d == 0, np.inf, (np.sign(d) * HALF - o) / d).min(axis=-1)
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
        far=13.0,
        max_depth=FURNACE_DEPTH,
        emitters_seen=True,
        truth=furnace_truth,
    ),
}
