"""A glowing core in a ball of clear glass under an even sky.

A ray that misses the core carries the sky's radiance, whatever the glass does to it: nothing is lost. One that enters
at an impact parameter b passes the centre at b / n, meets the core there, and comes out with the share that Fresnel's
equations let through, its radiance divided by n²; what they turn back is sky.
"""

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import BLACK, fields, glow, patchwork, sky
from scenes.modelling.scene import Description, Scene
from scenes.modelling.truth import Seen, Truth

RADIUS, CORE = 0.9, 0.4
INDEX = 1.5


def core_pixels() -> np.ndarray:
    return patchwork(41, 6, 12)


def core() -> Description:
    """Make the glowing ball alone."""
    return {"type": "sphere", "radius": CORE, "bsdf": BLACK, "emitter": glow(fields(core_pixels()))}


def glass(name: str, title: str, index: float) -> Scene:
    """Make the glass of that index of refraction; 1 is air, and must be invisible."""

    def build() -> Description:
        shell = {"type": "sphere", "radius": RADIUS,
                 "bsdf": {"type": "dielectric", "int_ior": index, "ext_ior": 1.0}}  # fmt: skip
        return {"sky": sky(), "glass": shell, "core": core()}

    return Scene(name=name, title=title, build=build, max_depth=40, truth=glass_truth(index))


def reflected(cosine: np.ndarray, index: float) -> np.ndarray:
    """Return the share of unpolarised light that glass reflects, entering from air (Fresnel)."""
    inner = np.sqrt(1 - (1 - cosine**2) / index**2)
    across = (cosine - index * inner) / (cosine + index * inner)
    along = (index * cosine - inner) / (index * cosine + inner)
    result: np.ndarray = (across**2 + along**2) / 2
    return result


def glass_truth(index: float) -> Truth:
    def truth(o: np.ndarray, d: np.ndarray) -> Seen:
        t = geometry.first_ball(o, d, (0.0, 0.0, 0.0), RADIUS)
        hit = np.isfinite(t)
        point = geometry.at(o, d, t)
        normal = point / RADIUS
        cosine = np.clip(-(d * normal).sum(-1), 1e-9, 1.0)
        inner = np.sqrt(1 - (1 - cosine**2) / index**2)
        bent = d / index + (cosine / index - inner)[:, None] * normal
        deep = geometry.first_ball(point, bent, (0.0, 0.0, 0.0), CORE)
        shown = geometry.ball_texture(core_pixels(), geometry.at(point, bent, deep) / CORE) / index**2
        back = reflected(cosine, index)[:, None]
        colour = np.where((hit & np.isfinite(deep))[:, None], back + (1 - back) * shown, 1.0)
        return Seen(np.where(hit[:, None], colour, 0.0), hit.astype(float), np.where(hit, t, 0.0))

    return truth


SCENES = {
    "glass": glass("glass", "A core in glass of index 1.5: it looks larger and nearer than it is", INDEX),
    "glass_air": glass("glass_air", "The same core in glass of index 1.0, which over white must vanish", 1.0),
}
