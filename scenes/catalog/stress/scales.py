"""A scene of unit size, described in units that exceed Mitsuba's single precision and ray epsilon."""

from scenes.catalog.stress.patterns import chequers, fields, floor, patchwork, rgb, sky
from scenes.modelling.normalise import Similarity
from scenes.modelling.scene import Description, Scene
from scenes.modelling.solids import mesh, rounded_box
from scenes.modelling.surfaces import matte

TINY = Similarity(1e-4, (0.0, 0.0, 0.0))
HUGE = Similarity(1e4, (1e5, -1e5, 5e4))


def unit() -> Description:
    """Describe a ball, a block and a niche on a floor, so close that light bounces between them; ±1 about 0."""
    chequered = matte(fields(chequers(8, 8, (0.85, 0.80, 0.70), (0.45, 0.50, 0.60))))
    patched = matte(fields(patchwork(53, 6, 12, 0.4, 0.95)))
    return {
        "sky": sky(),
        "floor": floor(1.0, -0.5, bsdf=chequered),
        "ball": {"type": "sphere", "center": [0.1, 0.05, 0.0], "radius": 0.5, "bsdf": patched},
        "block": mesh(rounded_box(0.5, 1.6, 0.5, 0.03).moved(-0.72, 0.0, -0.249), matte(rgb(0.8, 0.55, 0.4))),
    }


def described(scale: Similarity) -> Description:
    return scale.applied(unit())


def described_as(name: str, title: str, scale: Similarity) -> Scene:
    return Scene(name, title, lambda: described(scale))


SCENES = [
    described_as("tiny", "The unit scene described at scale 1e-4; normalised before it is rendered", TINY),
    described_as("huge", "The same at scale 1e4 and 1e5 away; normalised before it is rendered", HUGE),
]
