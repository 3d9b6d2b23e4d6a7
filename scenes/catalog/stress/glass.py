"""A glowing core in a ball of clear glass under an even sky.

A ray that misses the core carries the sky's radiance, as the glass absorbs nothing. A ray of impact parameter b passes
the centre at b / n and meets the core there. It carries the core's radiance, divided by n², times the share that
Fresnel's equations transmit; the rest is the sky's.
"""

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import fields, glowing, patchwork, sky
from scenes.modelling.scene import Description, Scene
from scenes.modelling.truth import Seen

RADIUS, CORE = 0.9, 0.4
PIXELS = patchwork(41, 6, 12)


def glass(name: str, title: str, index: float) -> Scene:
    """Make the glass of that index of refraction; 1 is air, and must be invisible."""

    def build() -> Description:
        bsdf = {"type": "dielectric", "int_ior": index, "ext_ior": 1.0}
        core = {"type": "sphere", "radius": CORE, **glowing(fields(PIXELS))}
        return {"sky": sky(), "glass": {"type": "sphere", "radius": RADIUS, "bsdf": bsdf}, "core": core}

    def truth(o: np.ndarray, d: np.ndarray) -> Seen:
        t = geometry.first_ball(o, d, geometry.ORIGIN, RADIUS)
        point = geometry.at(o, d, t)
        normal = point / RADIUS
        cosine = np.clip(-(d * normal).sum(-1), 1e-9, 1.0)
        inner = np.sqrt(1 - (1 - cosine**2) / index**2)
        bent = d / index + (cosine / index - inner)[:, None] * normal
        deep = geometry.first_ball(point, bent, geometry.ORIGIN, CORE)
        shown = geometry.ball_texture(PIXELS, geometry.at(point, bent, deep) / CORE) / index**2
        # Fresnel: the share of unpolarised light that glass reflects, entering from air
        across = (cosine - index * inner) / (cosine + index * inner)
        along = (index * cosine - inner) / (index * cosine + inner)
        back = ((across**2 + along**2) / 2)[:, None]
        met = np.isfinite(t) & np.isfinite(deep)
        return Seen.at(t, np.where(met[:, None], back + (1 - back) * shown, 1.0))

    return Scene(name, title, build, max_depth=40, truth=truth)


SCENES = [
    glass("glass", "A core in glass of index 1.5: it looks larger and nearer than it is", 1.5),
    glass("glass_air", "The same core in glass of index 1.0, which over white must vanish", 1.0),
]
