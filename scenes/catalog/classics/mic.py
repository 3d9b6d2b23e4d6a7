"""A vintage microphone: a woven wire head with dark foam inside, metal bands, a thin bent stand, a cable."""

import numpy as np

from scenes.modelling import surfaces
from scenes.modelling.lighting import studio
from scenes.modelling.parts import Parts, around, each, merged, meshes, mirrored, together
from scenes.modelling.scene import Description, Scene
from scenes.modelling.solids import Solid, ball, box, cylinder, lathe, rod, rounded_box, smooth, spline, tube

RADIUS, HALF = 0.43, 0.10
"""The radius of the head, a ball cut at its equator, and the distance that each half is pushed away along the axis."""
HEAD, TILT = (0.42, 0.0, 0.58), 40.0
"""The middle of the head and how far, in degrees, its axis leans towards +x."""
NECK = -HALF - RADIUS
"""The place along the axis, from the middle of the head, where the handle begins."""
FLOOR = -1.10
FOOT = -0.14


def head_surface(polar: np.ndarray, azimuth: np.ndarray, lift: np.ndarray | float = 0.0) -> np.ndarray:
    """Points on the pill, `polar` by arc length from 0 at the crown to 1 at the neck, `lift` above the surface."""
    s = polar * (np.pi * RADIUS + 2 * HALF)
    quarter = np.pi / 2 * RADIUS
    theta = (np.minimum(s, quarter) + np.maximum(s - quarter - 2 * HALF, 0.0)) / RADIUS
    middle = HALF - np.clip(s - quarter, 0.0, 2 * HALF)
    out = (RADIUS + lift) * np.sin(theta)
    return np.stack([out * np.cos(azimuth), out * np.sin(azimuth), middle + (RADIUS + lift) * np.cos(theta)], axis=-1)


def grille(wires: int = 28, wire: float = 0.0085) -> Solid:
    """Two families of wires that wind in opposite senses; each goes over one and under the next at the crossings."""
    polar = np.linspace(0.075, 0.88, 190)
    winding = 2 * np.pi * 0.75 * np.linspace(0.0, 1.0, len(polar))
    weave = 0.85 * wire * np.cos(wires * winding)
    pair = [tube(head_surface(polar, sense * winding, sense * weave), wire, 6) for sense in (1, -1)]
    return smooth(around(merged(pair), wires))


def head() -> Parts:
    polar = np.linspace(0.0, 1.0, 60)[::-1]
    foam = lathe([(x, z) for x, _, z in head_surface(polar, np.zeros(60), -0.05)], 48)
    outer = RADIUS + 0.018
    lower = [(RADIUS - 0.02, -0.06), (outer + 0.012, -0.06), (outer + 0.016, -0.048), (outer, -0.035)]
    band = lathe([*lower, *((r, -z) for r, z in reversed(lower)), lower[0]], 96)
    rivets = around(ball(0.013, 10).moved(outer), 24)
    crown = HALF + RADIUS
    dome = [(0.0, -0.05), (0.12, -0.035), (0.128, -0.01), (0.07, 0.012), (0.0, 0.018)]
    cap = lathe([(r, crown + z) for r, z in dome])
    spans = [np.linspace(start, end, 24) for start, end in ((0.07, 0.42), (0.58, 0.9))]
    ribs = [tube(head_surface(span, np.zeros(24), 0.012), 0.017, 8) for span in spans]
    return {"foam": [foam], "wire": [grille()], "chrome": [band, cap, around(merged(ribs), 4)], "brass": [rivets]}


def handle() -> Parts:
    waist = [(0.12, -0.09), (0.175, -0.09), (0.19, -0.07), (0.19, -0.03), (0.175, -0.01), (0.19, 0.01)]
    collar = lathe([*waist, (0.26, 0.07), (0.27, 0.085), (0.26, 0.10), (0.18, 0.10)], 64)
    barrel = [(0.09, -0.74), (0.105, -0.73)]
    for groove in np.linspace(-0.69, -0.57, 4):
        barrel += [(0.108, groove), (0.098, groove + 0.008), (0.098, groove + 0.02), (0.110, groove + 0.028)]
    barrel += [(0.128, -0.40), (0.158, -0.12), (0.16, -0.08), (0.14, -0.07)]
    rings = [
        lathe([(r - 0.02, z - 0.014), (r, z - 0.014), (r + 0.006, z), (r, z + 0.014), (r - 0.02, z + 0.014)], 48)
        for r, z in ((0.112, -0.745), (0.118, -0.50), (0.164, -0.11))
    ]
    plug = lathe([(0.0, -0.95), (0.03, -0.95), (0.045, -0.93), (0.07, -0.81), (0.09, -0.77), (0.09, -0.74)], 40)
    # the switch looks up
    plate = rounded_box(0.03, 0.065, 0.13, 0.012).turned(-6, (0, 1, 0)).moved(-0.146, 0, -0.205)
    slider = rounded_box(0.04, 0.04, 0.05, 0.01).turned(-6, (0, 1, 0)).moved(-0.164, 0, -0.19)
    parts = {"chrome": [collar, plate], "lacquer": [lathe(barrel, 64)], "brass": rings, "rubber": [plug, slider]}
    return each(parts, lambda solid: solid.moved(z=NECK))


def on_axis(along: float, below: float = 0.0) -> np.ndarray:
    """Return the world place of a point on the microphone's axis (or that far below it)."""
    t = np.radians(TILT)
    return np.array(HEAD) + along * np.array([np.sin(t), 0, np.cos(t)]) + below * np.array([np.cos(t), 0, -np.sin(t)])


def clip() -> Parts:
    at = NECK - 0.34
    ring = lathe([(0.135, -0.05), (0.158, -0.05), (0.158, 0.05), (0.142, 0.05), (0.135, -0.05)], 48).moved(z=at)
    lug = box(0.09, 0.05, 0.08).moved(0.185, 0, at)
    screw = cylinder(0.018, 0.20, 14).turned(90, (1, 0, 0)).moved(0.215, 0, at)
    knob = around(cylinder(0.016, 0.03, 8).moved(0.034), 6).turned(90, (1, 0, 0)).moved(0.215, 0.11, at)
    hub = cylinder(0.04, 0.028, 20).turned(90, (1, 0, 0)).moved(0.215, 0.11, at)
    cheeks = mirrored(rounded_box(0.09, 0.02, 0.075, 0.009).moved(0.225, 0.036, at))
    return {"rubber": [ring, lug], "brass": [screw, knob, hub], "chrome": [cheeks]}


def stand() -> Parts:
    """A heavy round base with a trim, thin pole with a knurled sleeve, a ribbed arm that curves up to the clip."""
    base = [(0.0, 0.0), (0.40, 0.0), (0.42, 0.02), (0.415, 0.045), (0.29, 0.075), (0.12, 0.10), (0.075, 0.13)]
    trim = [(0.40, 0.004), (0.432, 0.004), (0.436, 0.018), (0.428, 0.03), (0.40, 0.03)]
    sleeve = [(0.0, 0.43), (0.04, 0.43), (0.046, 0.44), (0.046, 0.52), (0.04, 0.53), (0.0, 0.53)]
    grip = around(rod((0.046, 0, 0.445), (0.046, 0, 0.515), 0.005, 6), 24)
    foot = {
        "iron": [lathe([*base, (0.05, 0.19), (0.0, 0.19)], 96)],
        "brass": [lathe(trim, 96)],
        "chrome": [rod((0, 0, 0.15), (0, 0, 0.56), 0.024, 20), lathe(sleeve, 40), grip],
    }
    placed = each(foot, lambda solid: solid.moved(x=FOOT, z=FLOOR))
    end = on_axis(NECK - 0.34, 0.27)
    top = FLOOR + 0.54
    way = [(FOOT, 0, top), (FOOT + 0.02, 0, top + 0.10), (FOOT + 0.17, 0, top + 0.20), (FOOT + 0.33, 0, top + 0.30)]
    path = spline([*way, (FOOT + 0.33, 0, top + 0.42), end, on_axis(NECK - 0.34, 0.22)], 320)
    neck = tube(path, 0.027 + 0.005 * np.cos(np.arange(320) * 2 * np.pi / 5), 14)
    return placed | {"arm": [neck]}


def cable() -> Parts:
    """A cable from the plug down to the floor, once round the base and away to a jack."""
    hang = [on_axis(NECK - 0.90), on_axis(NECK - 0.93), on_axis(NECK - 1.0)]
    fall = [(-0.70, 0.03, -0.72), (-0.70, 0.08, -0.95)]
    turn, radius = np.radians(np.linspace(165, -150, 12)), np.linspace(0.52, 0.56, 12)
    coil = np.c_[FOOT + radius * np.cos(turn), radius * np.sin(turn), np.full(12, FLOOR + 0.022)]
    away = [(x, y, FLOOR + 0.02) for x, y in ((-0.52, -0.52), (-0.30, -0.68), (0.0, -0.66), (0.22, -0.72))]
    path = spline(np.array([*hang, *fall, *coil, *away]), 200)
    path[:, 2] = np.maximum(path[:, 2], FLOOR + 0.02)
    jack = rod(path[-2], path[-1] + 5 * (path[-1] - path[-2]), 0.03, 12)
    return {"rubber": [tube(path, 0.02, 8), jack]}


MATERIALS: dict[str, Description] = {
    "foam": surfaces.cloth((0.022, 0.02, 0.02), sheen=1.0),
    "wire": surfaces.metal("aluminium", 0.22),
    "chrome": surfaces.metal("aluminium", 0.07),
    "arm": surfaces.metal("aluminium", 0.14),
    "brass": surfaces.metal("brass", 0.12),
    "lacquer": surfaces.plastic(surfaces.srgb("#15181c"), surfaces.VARNISH),
    "iron": surfaces.plastic(surfaces.srgb("#2b2d31"), 0.22),
    "rubber": surfaces.plastic(surfaces.BLACK_RUBBER, surfaces.RUBBER),
}


def build() -> Description:
    tipped = each(together(head(), handle(), clip()), lambda solid: solid.turned(TILT, (0, 1, 0)).moved(*HEAD))
    parts = each(together(tipped, stand(), cable()), lambda solid: solid.scaled(0.95))
    return {"type": "scene", "light": studio()} | meshes(parts, MATERIALS)


SCENE = Scene("mic", "Vintage microphone: a woven wire head, polished metal, a thin bent stand", build, max_depth=8)
