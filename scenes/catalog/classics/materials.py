"""Balls of many materials, floating side by side."""

import numpy as np

from scenes.modelling import surfaces
from scenes.modelling.lighting import studio
from scenes.modelling.scene import Description, Scene

RADIUS = 0.25
SPACING = 0.565
ROWS = (3, 4, 4, 3)
"""The number of balls in each row; the rows lie along y."""


def build() -> Description:
    scene: Description = {"type": "scene", "light": studio()}
    places = [(row, place - (count - 1) / 2) for row, count in enumerate(ROWS) for place in range(count)]
    for (name, bsdf), (row, place) in zip(materials().items(), places, strict=True):
        matrix = np.diag([RADIUS, RADIUS, RADIUS, 1.0])
        matrix[:3, 3] = SPACING * np.array([row - (len(ROWS) - 1) / 2, place, 0.0])
        scene[name] = {"type": "sphere", "to_world": matrix, "bsdf": bsdf}
    return scene


def materials() -> dict[str, Description]:
    return {
        "gold": surfaces.metal("gold", 0.06),
        "red_lacquer": surfaces.plastic(surfaces.srgb("#c01818"), surfaces.GLAZE),
        "chequered": surfaces.plastic(surfaces.texture(chequers()), 0.1),
        "glass": surfaces.glass(),
        "copper": surfaces.metal("copper", 0.08),
        "green_plastic": surfaces.plastic(surfaces.srgb("#2f9a35"), 0.18),
        "mirror": surfaces.metal("silver"),
        "blue_plastic": surfaces.plastic(surfaces.srgb("#1d4fc4"), 0.05),
        "wood": surfaces.plastic(surfaces.texture(wood()), surfaces.VARNISH),
        "frosted_glass": surfaces.tinted(surfaces.glass(roughness=0.08), (0.70, 0.95, 0.92)),
        "chalk": surfaces.matte((0.42, 0.24, 0.62)),
        "rubber": surfaces.plastic(surfaces.BLACK_RUBBER, surfaces.RUBBER),
        "brushed_steel": surfaces.metal("aluminium", 0.3),
        "marble": surfaces.plastic(surfaces.texture(marble()), surfaces.GLAZE),
    }


def chequers() -> np.ndarray:
    rows, columns = np.indices((256, 512)) // 32
    return surfaces.mixed((0.80, 0.55, 0.06), (0.04, 0.04, 0.045), ((rows + columns) % 2).astype(float))


def wood() -> np.ndarray:
    height, width = 256, 512
    ring = 7 * np.linspace(0, 1, height)[:, None] + 3.2 * surfaces.mottle(11, height, width, 2.2)
    grain = 0.5 + 0.5 * np.sin(2 * np.pi * ring)
    return surfaces.mixed((0.13, 0.05, 0.018), (0.42, 0.19, 0.065), grain**1.5)


def marble() -> np.ndarray:
    """A white marble with thin dark veins where a cloudy pattern crosses its middle."""
    height, width = 256, 512
    distance = np.abs(surfaces.mottle(13, height, width, 1.7) - 0.5)
    return surfaces.mixed((0.80, 0.79, 0.76), (0.10, 0.14, 0.13), np.exp(-((distance / 0.035) ** 1.2)))


SCENE = Scene(
    "materials", "Fourteen balls: metals, plastics, glass, wood, marble; reflections that move with the eye", build,
    max_depth=10,
)  # fmt: skip
