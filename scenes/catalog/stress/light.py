"""Extreme light: an emitter a million times as bright as the floor that it lights, and light at grazing incidence."""

import math

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import chequers, fields, floor, glowing, rgb
from scenes.modelling.lighting import towards
from scenes.modelling.scene import Description, Scene
from scenes.modelling.surfaces import matte
from scenes.modelling.truth import Seen

HALF = 0.95
"""Half an edge of the floors, which lie at the heights below."""
HDR_FLOOR, GRAZING_FLOOR = -0.4, -0.2
LAMP, LAMP_RADIUS = (0.0, 0.0, 0.15), 0.12
BRIGHTEST = 0.8
RATIO = 1e6
ELEVATION = 0.1
"""The degrees above the horizon: light meets the floor at 89.9° from its normal."""
SUN = towards(20.0, ELEVATION)
DOMES = {"high": ((0.35, 0.25, GRAZING_FLOOR), 0.35), "low": ((-0.35, -0.45, GRAZING_FLOOR), 0.2)}
GRAZING_PIXELS = chequers(6, 6, (0.70, 0.66, 0.60), (0.25, 0.32, 0.40))
IRRADIANCE = math.pi * BRIGHTEST / 0.70 / math.sin(math.radians(ELEVATION))
"""The irradiance of a surface that faces the light; the floor gets a 573rd of it."""
DOME_ALBEDO = math.pi * BRIGHTEST / IRRADIANCE


def hdr(name: str, title: str, ratio: float) -> Scene:
    """Make a lamp that is `ratio` times as bright as the brightest spot of the floor that it lights; `ratio` ≥ 18."""
    highest = ((LAMP[2] - HDR_FLOOR) / LAMP_RADIUS) ** 2 / ratio
    pixels = chequers(8, 8, (highest, 0.8 * highest, 0.5 * highest), (0.2 * highest, 0.3 * highest, 0.5 * highest))

    def build() -> Description:
        lamp = {"type": "sphere", "center": list(LAMP), "radius": LAMP_RADIUS, **glowing(rgb(ratio * BRIGHTEST))}
        return {"lamp": lamp, "floor": floor(HALF, HDR_FLOOR, bsdf=matte(fields(pixels)))}

    def truth(o: np.ndarray, d: np.ndarray) -> Seen:
        """A ball of radiance L and radius r, at distance s above the horizon, gives π L (r / s)² cos θ."""
        below, lamp = geometry.square(o, d, HDR_FLOOR, HALF), geometry.first_ball(o, d, LAMP, LAMP_RADIUS)
        point = geometry.at(o, d, below)
        to_lamp = np.array(LAMP) - point
        distance = np.linalg.norm(to_lamp, axis=-1)
        share = (LAMP_RADIUS / distance) ** 2 * to_lamp[:, 2] / distance
        lit = geometry.square_texture(pixels, point, HALF) * (share * ratio * BRIGHTEST)[:, None]
        return Seen.at(np.minimum(below, lamp), np.where((lamp < below)[:, None], ratio * BRIGHTEST, lit))

    return Scene(name, title, build, emitters_seen=True, truth=truth)


def grazing() -> Description:
    domes = {
        name: {"type": "sphere", "center": list(centre), "radius": radius, "bsdf": matte(rgb(DOME_ALBEDO))}
        for name, (centre, radius) in DOMES.items()
    }
    sun = {"type": "directional", "direction": (-SUN).tolist(), "irradiance": rgb(IRRADIANCE)}
    return {"sun": sun, "floor": floor(HALF, GRAZING_FLOOR, bsdf=matte(fields(GRAZING_PIXELS))), **domes}


def shadowed(point: np.ndarray, without: str = "") -> np.ndarray:
    """Return whether a dome blocks the light, [points]."""
    light = np.broadcast_to(SUN, point.shape)
    others = [dome for name, dome in DOMES.items() if name != without]
    return np.asarray(
        np.any([np.isfinite(geometry.first_ball(point, light, centre, radius)) for centre, radius in others], axis=0)
    )


def grazing_truth(o: np.ndarray, d: np.ndarray) -> Seen:
    """Return what rays see of light that comes straight from the sun; `max_depth` 2 excludes bounces."""
    t = geometry.square(o, d, GRAZING_FLOOR, HALF)
    point = geometry.at(o, d, t)
    albedo = geometry.square_texture(GRAZING_PIXELS, point, HALF)
    colour = albedo * (IRRADIANCE / math.pi * SUN[2]) * ~shadowed(point)[:, None]
    for name, (centre, radius) in DOMES.items():
        dome = geometry.first_ball(o, d, centre, radius)
        point = geometry.at(o, d, dome)
        cosine = np.maximum((point - centre) / radius @ SUN, 0.0) * ~shadowed(point, without=name)
        lit = np.repeat(DOME_ALBEDO * IRRADIANCE / math.pi * cosine[:, None], 3, axis=1)
        colour, t = np.where((dome < t)[:, None], lit, colour), np.where(dome < t, dome, t)
    return Seen.at(t, colour)


SCENES = [
    hdr("hdr_emitter", "A lamp a million times as bright as the floor that it lights", RATIO),
    Scene(
        "grazing", "Sunlight at 89.9° to the floor's normal: domes glare, their shadows never end",
        grazing, max_depth=2, truth=grazing_truth,
    ),
]  # fmt: skip
