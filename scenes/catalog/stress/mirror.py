"""A perfect mirror ball over a glowing floor, among glowing balls: every ray that it reflects is known."""

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import chequers, fields, floor, glowing, patchwork
from scenes.modelling.scene import Description, Scene
from scenes.modelling.truth import Seen

HALF, HEIGHT = 0.95, -0.5
CENTRE, RADIUS = (0.0, 0.0, 0.05), 0.5
FLOOR = chequers(8, 8, (0.70, 0.62, 0.45), (0.10, 0.14, 0.22))
BALLS = {
    "a": ((0.68, 0.10, -0.28), 0.20),
    "b": ((-0.35, 0.62, -0.30), 0.18),
    "c": ((-0.40, -0.60, -0.26), 0.22),
    "d": ((0.05, 0.85, 0.45), 0.16),
    "e": ((-0.80, -0.20, 0.50), 0.18),
    "f": ((0.65, -0.62, 0.48), 0.17),
}


def ball_pixels(name: str) -> np.ndarray:
    return patchwork(31 + ord(name), 4, 8)


def build() -> Description:
    balls = {
        name: {"type": "sphere", "center": list(centre), "radius": radius, **glowing(fields(ball_pixels(name)))}
        for name, (centre, radius) in BALLS.items()
    }
    bsdf = {"type": "conductor", "material": "none"}
    mirror = {"type": "sphere", "center": list(CENTRE), "radius": RADIUS, "bsdf": bsdf}
    return {"floor": floor(HALF, HEIGHT, **glowing(fields(FLOOR))), "mirror": mirror, **balls}


def lights(o: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return radiance [rays, 3] and distance [rays] of the first glowing surface; 0 and inf without one."""
    t = geometry.square(o, d, HEIGHT, HALF)
    texture = geometry.square_texture(FLOOR, geometry.at(o, d, t), HALF)
    colour = np.where((np.isfinite(t) & (d[:, 2] < 0))[:, None], texture, 0.0)
    for name, (centre, radius) in BALLS.items():
        ball = geometry.first_ball(o, d, centre, radius)
        normal = (geometry.at(o, d, ball) - centre) / radius
        colour = np.where((ball < t)[:, None], geometry.ball_texture(ball_pixels(name), normal), colour)
        t = np.where(ball < t, ball, t)
    return colour, t


def truth(o: np.ndarray, d: np.ndarray) -> Seen:
    colour, t = lights(o, d)
    mirror = geometry.first_ball(o, d, CENTRE, RADIUS)
    point = geometry.at(o, d, mirror)
    normal = (point - CENTRE) / RADIUS
    shown, _ = lights(point, d - 2 * (d * normal).sum(-1, keepdims=True) * normal)
    nearer = mirror < t
    return Seen.at(np.where(nearer, mirror, t), np.where(nearer[:, None], shown, colour))


SCENES = [
    Scene(
        "mirror", "A perfect mirror over a glowing floor: what it shows lies behind it and moves with the eye",
        build, emitters_seen=True, truth=truth,
    )
]  # fmt: skip
