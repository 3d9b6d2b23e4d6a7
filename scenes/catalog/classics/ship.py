"""A three-masted sailing ship in a basin of clear water over sand."""

import numpy as np

from scenes.catalog.classics import ship_hull, ship_rig
from scenes.catalog.classics.ship_hull import WATER
from scenes.modelling import surfaces
from scenes.modelling.lighting import hazed, studio
from scenes.modelling.parts import merged
from scenes.modelling.scene import Description, Scene
from scenes.modelling.solids import Solid, lathe, mesh, sheet, smooth

BASIN_RADIUS, BASIN_BOTTOM = 1.08, -0.68


def build() -> Description:
    set_sails, furled = ship_rig.sails()
    dark_wood = surfaces.plastic(surfaces.srgb("#3a2416"), roughness=0.3)
    return {
        "type": "scene",
        "light": hazed(studio(brightness=1.35), share=0.4),
        "basin": mesh(basin(), surfaces.plastic((0.055, 0.08, 0.095), roughness=0.2)),
        "seabed": mesh(seabed(), surfaces.matte(surfaces.texture(sand()))),
        "water": mesh(water(), surfaces.tinted(surfaces.glass(index=1.333), (0.72, 0.90, 0.93))),
        "hull": mesh(ship_hull.hull(), surfaces.plastic(surfaces.texture(ship_hull.planks()), roughness=0.3)),
        "spars": mesh(ship_rig.spars(), surfaces.plastic(surfaces.srgb("#8a5a2c"), roughness=0.3)),
        "fittings": mesh(merged([ship_hull.fittings(), ship_rig.tops()]), dark_wood),
        "gilding": mesh(ship_hull.gilding(), surfaces.metal("gold", 0.2)),
        "rigging": mesh(ship_rig.rigging(), surfaces.matte(surfaces.srgb("#3b2c1d"))),
        "sails": mesh(set_sails, surfaces.thin(surfaces.texture(ship_rig.canvas()), 0.3, roughness=0.9)),
        "furled": mesh(furled, surfaces.matte((0.62, 0.54, 0.40))),
        "flag": mesh(ship_rig.flag(), surfaces.thin(surfaces.srgb("#b3161b"), 0.3, roughness=0.8)),
    }


def basin() -> Solid:
    r, low = BASIN_RADIUS, BASIN_BOTTOM
    outside = [(0, low), (r - 0.08, low), (r - 0.05, low + 0.01), (r - 0.01, low + 0.05), (r, low + 0.1)]
    rim = [(r + 0.005, WATER + 0.01), (r + 0.003, WATER + 0.02), (r - 0.005, WATER + 0.026), (r - 0.028, WATER + 0.026)]
    inside = [(r - 0.036, WATER + 0.02), (r - 0.038, WATER + 0.01), (r - 0.04, low + 0.03), (0, low + 0.03)]
    return smooth(lathe([*outside, *rim, *inside], segments=128))


def disc(radius: float, rings: int, segments: int) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y [segments + 1, rings] over a disc, from the centre out; for `sheet`."""
    angle = np.linspace(0, -2 * np.pi, segments + 1)[:, None]
    r = radius * np.linspace(0, 1, rings)
    return np.cos(angle) * r, np.sin(angle) * r


def waves(x: np.ndarray, y: np.ndarray, seed: int, longest: float, height: float, count: int = 14) -> np.ndarray:
    random = np.random.default_rng(seed)
    z = np.zeros_like(x)
    for length in np.geomspace(longest, longest / 4, count):
        heading = random.normal(0.6, 0.7)
        phase = 2 * np.pi * (random.uniform() + (np.cos(heading) * x + np.sin(heading) * y) / length)
        z += height * length / longest * np.sin(phase)
    return z


def water() -> Solid:
    """A closed body of water: its sides lie inside the wall of the basin, its bottom below the sand."""
    radius = BASIN_RADIUS - 0.02
    x, y = disc(radius, rings=110, segments=240)
    ripple = waves(x, y, seed=7, longest=0.34, height=0.0045)
    skirt_x, skirt_y = x[:, -1:] * np.array([1.0, 0.0]), y[:, -1:] * np.array([1.0, 0.0])
    bottom = np.full_like(skirt_x, BASIN_BOTTOM + 0.015)
    z = np.concatenate([WATER + ripple, bottom], axis=1)
    vertices = np.stack([np.hstack([x, skirt_x]), np.hstack([y, skirt_y]), z], axis=-1)
    return sheet(vertices)


def seabed() -> Solid:
    """A seabed of dunes that rise towards the wall; open below, where nothing looks."""
    x, y = disc(BASIN_RADIUS - 0.03, rings=50, segments=120)
    r = np.hypot(x, y) / BASIN_RADIUS
    z = BASIN_BOTTOM + 0.075 + 0.09 * r**4 + waves(x, y, seed=3, longest=0.6, height=0.005)
    vertices = np.stack([x, y, z], axis=-1)
    return sheet(vertices, vertices[..., :2] / (2 * BASIN_RADIUS) + 0.5)


def sand() -> np.ndarray:
    grain = surfaces.mixed((0.08, 0.18, 0.19), (0.36, 0.37, 0.27), surfaces.mottle(21, 256, 256, 1.3))
    weed = 1 / (1 + np.exp(-(surfaces.mottle(22, 256, 256, 1.9) - 0.68) / 0.02))
    return np.asarray(grain + weed[..., None] * (np.array((0.018, 0.05, 0.035)) - grain))


SCENE = Scene(
    "ship", "A sailing ship in water: rigging thinner than a pixel, a hull seen through waves", build, max_depth=10
)
