"""Extreme light: an emitter a million times as bright as the surface it lights, and light that all but misses the
floor.
"""

import math

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import BLACK, chequers, diffuse, fields, glow, level, rgb
from scenes.modelling.lighting import towards
from scenes.modelling.scene import Description, Scene
from scenes.modelling.truth import Seen, Truth

HALF = 0.95
"""Half an edge of the floors, which lie at the heights below."""
HDR_FLOOR, GRAZING_FLOOR = -0.4, -0.2
LAMP, LAMP_RADIUS = (0.0, 0.0, 0.15), 0.12
BRIGHTEST = 0.8
"""The radiance of the floor at its brightest."""
RATIO = 1e6
ELEVATION = 0.1
"""The degrees above the horizon: light meets the floor at 89.9° from its normal."""
AZIMUTH = 20.0
DOMES = {"high": ((0.35, 0.25, GRAZING_FLOOR), 0.35), "low": ((-0.35, -0.45, GRAZING_FLOOR), 0.2)}


def hdr(name: str, title: str, ratio: float) -> Scene:
    """Make a lamp that is `ratio` times as bright as the brightest spot of the floor that it lights; `ratio` ≥ 18."""
    pixels, radiance = hdr_floor(ratio), ratio * BRIGHTEST

    def build() -> Description:
        lamp = {"type": "sphere", "center": list(LAMP), "radius": LAMP_RADIUS, "bsdf": BLACK,
                "emitter": glow(rgb(radiance))}  # fmt: skip
        floor = {"type": "rectangle", "to_world": level(HALF, HDR_FLOOR), "bsdf": diffuse(fields(pixels))}
        return {"lamp": lamp, "floor": floor}

    return Scene(name=name, title=title, build=build, emitters_seen=True, truth=hdr_truth(ratio))


def hdr_floor(ratio: float) -> np.ndarray:
    """Return the albedo of the floor: as dark as the lamp is bright."""
    highest = ((LAMP[2] - HDR_FLOOR) / LAMP_RADIUS) ** 2 / ratio
    return chequers(8, 8, (highest, 0.8 * highest, 0.5 * highest), (0.2 * highest, 0.3 * highest, 0.5 * highest))


def hdr_truth(ratio: float) -> Truth:
    """Return what rays see: a ball of radiance L, radius r, at distance s above the horizon, gives π L
    (r / s)² cos θ.
    """

    def truth(o: np.ndarray, d: np.ndarray) -> Seen:
        floor, lamp = geometry.square(o, d, HDR_FLOOR, HALF), geometry.first_ball(o, d, LAMP, LAMP_RADIUS)
        point = geometry.at(o, d, floor)
        to_lamp = np.array(LAMP) - point
        distance = np.linalg.norm(to_lamp, axis=-1)
        share = (LAMP_RADIUS / distance) ** 2 * to_lamp[:, 2] / distance
        lit = geometry.square_texture(hdr_floor(ratio), point, HALF) * (share * ratio * BRIGHTEST)[:, None]
        t = np.minimum(floor, lamp)
        hit = np.isfinite(t)
        colour = np.where((lamp < floor)[:, None], ratio * BRIGHTEST, lit)
        return Seen(np.where(hit[:, None], colour, 0.0), hit.astype(float), np.where(hit, t, 0.0))

    return truth


GRAZING_PIXELS = chequers(6, 6, (0.70, 0.66, 0.60), (0.25, 0.32, 0.40))
IRRADIANCE = math.pi * BRIGHTEST / 0.70 / math.sin(math.radians(ELEVATION))
"""The irradiance of a surface that faces the light; the floor gets a 573rd of it."""
DOME_ALBEDO = math.pi * BRIGHTEST / IRRADIANCE


def grazing() -> Description:
    domes = {
        name: {"type": "sphere", "center": list(centre), "radius": radius, "bsdf": diffuse(rgb(DOME_ALBEDO))}
        for name, (centre, radius) in DOMES.items()
    }
    floor = {"type": "rectangle", "to_world": level(HALF, GRAZING_FLOOR), "bsdf": diffuse(fields(GRAZING_PIXELS))}
    sun = {"type": "directional", "direction": (-towards(AZIMUTH, ELEVATION)).tolist(), "irradiance": rgb(IRRADIANCE)}
    return {"sun": sun, "floor": floor, **domes}


def shadowed(point: np.ndarray, without: str = "") -> np.ndarray:
    """Return whether [points] a dome stands before the light."""
    light = np.broadcast_to(towards(AZIMUTH, ELEVATION), point.shape)
    hits = [
        np.isfinite(geometry.first_ball(point, light, centre, radius))
        for name, (centre, radius) in DOMES.items()
        if name != without
    ]
    result: np.ndarray = np.any(hits, axis=0)
    return result


def grazing_truth(o: np.ndarray, d: np.ndarray) -> Seen:
    """Return what rays see of light that comes straight from the sun; `max_depth` 2 excludes bounces."""
    sun = towards(AZIMUTH, ELEVATION)
    t = geometry.square(o, d, GRAZING_FLOOR, HALF)
    point = geometry.at(o, d, t)
    albedo = geometry.square_texture(GRAZING_PIXELS, point, HALF)
    colour = albedo * (IRRADIANCE / math.pi * sun[2]) * ~shadowed(point)[:, None]
    for name, (centre, radius) in DOMES.items():
        other = geometry.first_ball(o, d, centre, radius)
        nearer = other < t
        point = geometry.at(o, d, other)
        cosine = np.maximum((point - centre) / radius @ sun, 0.0) * ~shadowed(point, without=name)
        lit = np.repeat(DOME_ALBEDO * IRRADIANCE / math.pi * cosine[:, None], 3, axis=1)
        colour, t = np.where(nearer[:, None], lit, colour), np.where(nearer, other, t)
    hit = np.isfinite(t)
    return Seen(np.where(hit[:, None], colour, 0.0), hit.astype(float), np.where(hit, t, 0.0))


SCENES = {
    "hdr_emitter": hdr("hdr_emitter", "A lamp a million times as bright as the floor that it lights", RATIO),
    "grazing": Scene(
        name="grazing",
        title="Sunlight at 89.9° to the floor's normal: domes glare, their shadows never end",
        build=grazing,
        max_depth=2,
        truth=grazing_truth,
    ),
}
