"""A bulldozer of studded bricks on a baseplate: tracks, a curved blade on beams, hydraulics, a cab with a driver.

Lengths are in studs (the pitch of the grid), z in studs above the baseplate; `STUD` turns them into scene units.
"""

from itertools import accumulate

import numpy as np

from scenes.modelling import surfaces
from scenes.modelling.lighting import studio
from scenes.modelling.parts import Parts, around, each, merged, meshes, mirrored, together
from scenes.modelling.scene import Description, Scene
from scenes.modelling.solids import Solid, ball, box, creased, cylinder, lathe, loft, rod, rounded_box, tube

STUD = 0.118
PLATE, BRICK = 0.4, 1.2
GAP = 0.03

MATERIALS: dict[str, Description] = {
    "yellow": surfaces.plastic(surfaces.srgb("#f7c414"), 0.1),
    "grey": surfaces.plastic(surfaces.srgb("#a3a7a8"), 0.1),
    "dark": surfaces.plastic(surfaces.srgb("#4c5154"), 0.12),
    "black": surfaces.plastic(surfaces.srgb("#26272a"), surfaces.RUBBER),
    "sand": surfaces.plastic(surfaces.srgb("#a08d6c"), 0.14),
    "red": surfaces.plastic(surfaces.srgb("#c4140c"), 0.1),
    "blue": surfaces.plastic(surfaces.srgb("#1d56b0"), 0.1),
    "chrome": surfaces.metal("aluminium", 0.08),
    "lamp": surfaces.glass(1.5),
    "amber": surfaces.plastic(surfaces.srgb("#ff7a10"), 0.0),
}


def brick(x: float, y: float, z: float, length: int, width: int, height: float, studs: bool = True) -> Solid:
    """A brick from its lowest corner, a hair's breadth from its neighbours."""
    body = rounded_box(length - GAP, width - GAP, height - GAP / 2, 0.05, 2)
    body = body.moved(x + length / 2, y + width / 2, z + height / 2)
    knob = creased(cylinder(0.3, 0.2, 14))
    grid = [(x + i + 0.5, y + j + 0.5) for i in range(length) for j in range(width)] if studs else []
    return merged([body] + [knob.moved(u, v, z + height + 0.1) for u, v in grid])


def wall(x: float, y: float, z: float, lengths: list[int], width: int, height: float = BRICK) -> Solid:
    starts = accumulate(lengths[:-1], initial=0)
    return merged(brick(x + start, y, z, n, width, height, False) for start, n in zip(starts, lengths, strict=True))


def prism(outline: list[tuple[float, float]], low: float, high: float) -> Solid:
    """A prism of a convex outline in x and z, counter-clockwise with x right and z up, from y = low to high."""
    points = np.array(outline)
    rings = [np.c_[points[:, 0], np.full(len(points), y), points[:, 1]] for y in (high, low)]
    return creased(loft(np.array(rings)))


def strip(profile: np.ndarray, thickness: float, low: float, high: float) -> Solid:
    """A curved plate: a profile [N, 2] in x and z, thickened to its left, from y = low to high."""
    along = np.gradient(profile, axis=0)
    normal = np.c_[-along[:, 1], along[:, 0]] / np.linalg.norm(along, axis=1, keepdims=True)
    inner, outer = profile, profile + thickness * normal
    edges = ((inner, low), (inner, high), (outer, high), (outer, low))
    return creased(loft(np.stack([np.c_[edge[:, 0], np.full(len(edge), y), edge[:, 1]] for edge, y in edges], axis=1)))


def beam(holes: int) -> Solid:
    """A beam along x from hole 0 at the origin, pierced along y, round at the ends."""
    cell = lathe([(0.3, -0.45), (0.5, -0.45), (0.5, 0.45), (0.3, 0.45), (0.3, -0.45)], 16)
    radius = np.hypot(*cell.vertices[:, :2].T)
    cosine, sine = (cell.vertices[:, :2] / radius[:, None]).T
    square = 1 / np.maximum(np.abs(cosine), np.abs(sine))
    cells = []
    for hole in range(holes):
        free = ((hole == 0) & (cosine < 0)) | ((hole == holes - 1) & (cosine > 0))
        grow = np.where((radius > 0.4) & ~free, square, 1.0)
        cells.append(Solid(cell.vertices * np.c_[grow, grow, np.ones_like(grow)], cell.faces).moved(hole))
    return creased(merged(cells)).turned(90, (1, 0, 0))


def track() -> Parts:
    rear, front, middle, radius, height = -4.6, 3.4, 3.6, 1.35, 1.62
    straight = front - rear
    turn = np.pi * radius
    link = merged([box(0.46, 1.9, 0.16), box(0.12, 1.9, 0.2).moved(z=0.14), box(0.46, 0.3, 0.22).moved(z=-0.12)])
    links = []
    for s in np.linspace(0, 2 * (straight + turn), 46, endpoint=False):
        # along the top forwards, round the front, back along the ground, round the rear
        lap, rest = divmod(s, straight + turn)
        angle = 180 * max(0.0, rest - straight) / turn
        place = link.moved(min(rest, straight) - straight / 2, 0, radius)
        if angle > 0:
            place = link.moved(0, 0, radius).turned(angle, (0, 1, 0)).moved(straight / 2)
        links.append(place.turned(180 * lap, (0, 1, 0)).moved((front + rear) / 2, middle, height))
    rim = lathe([(0.85, -0.6), (1.2, -0.6), (1.2, 0.6), (0.85, 0.6), (0.85, -0.6)], 40)
    spokes = around(box(0.85, 0.26, 0.5).moved(0.5), 6)
    hub = merged([cylinder(0.36, 1.3, 24), spokes, box(0.2, 0.5, 1.5), box(0.5, 0.2, 1.5)])
    wheel = creased(merged([rim, hub])).turned(90, (1, 0, 0))
    roller = creased(lathe([(0, -0.5), (0.42, -0.5), (0.42, 0.5), (0, 0.5)], 24)).turned(90, (1, 0, 0))
    wheels = [wheel.moved(x, middle, height) for x in (rear, front)]
    rollers = [roller.moved(x, middle, 0.76) for x in (-2.9, -1.6, -0.3, 1.0, 2.0)]
    return {"black": [creased(merged(links))], "yellow": wheels, "grey": [*rollers, beam(9).moved(-4.6, 2.42, height)]}


def chassis() -> Parts:
    floor = wall(-6, -2, 1.3, [4, 4, 3], 4, 2 * PLATE)
    under = [brick(x, 2, 2.9, 2, 1, PLATE, False) for x in (-5, 2)]
    fender = merged([brick(-5, 2, 3.3, 9, 3, PLATE), *under])
    return {"dark": [floor], "yellow": [mirrored(fender)]}


def engine() -> Parts:
    hood = [wall(0, -2, 2.1, [2, 3], 4), wall(0, -2, 3.3, [3, 2], 4)]
    top = [brick(0, -2, 4.5, 3, 2, PLATE), brick(0, 0, 4.5, 3, 2, PLATE)]
    nose = prism([(3, 4.5), (5, 4.5), (5, 4.6), (3, 4.9)], -2 + GAP, 2 - GAP)
    slats = [box(0.14, 2.6, 0.12).moved(5.05, 0, z) for z in np.arange(2.5, 4.3, 0.28)]
    frame = [box(0.2, 0.16, 2.0).moved(5.05, y, 3.35) for y in (-1.38, 1.38)]
    lamps = [ball(0.34, 20).scaled(0.7, 1, 1).moved(5.1, y, 4.1) for y in (-1.72, 1.72)]
    sockets = [creased(cylinder(0.36, 0.3, 20)).turned(90, (0, 1, 0)).moved(4.98, y, 4.1) for y in (-1.72, 1.72)]
    muffler = [(0.2, 4.9), (0.2, 5.4), (0.34, 5.5), (0.34, 6.5), (0.2, 6.6), (0.2, 7.3), (0.13, 7.3), (0.13, 6.8)]
    exhaust = creased(lathe([*muffler, (0.0, 6.8)], 24))
    air_filter = creased(lathe([(0.3, 4.9), (0.3, 5.5), (0.5, 5.5), (0.5, 5.9), (0.0, 6.1)], 24))
    return {
        "yellow": [*hood, *top, nose],
        "dark": [*slats, *frame, air_filter.moved(1.2, -1.0)],
        "chrome": [exhaust.moved(2.2, 1.0), *sockets],
        "lamp": lamps,
    }


def cab() -> Parts:
    pillars = [box(0.28, 0.28, 3.8).moved(x, y, 4.9) for x in (-3.8, -0.2) for y in (-1.84, 1.84)]
    rails = [rod((-3.8, y, 4.6), (-0.2, y, 4.6), 0.09, 10) for y in (-1.84, 1.84)]
    roof = [brick(-4, -2, 6.8, 4, 4, PLATE), brick(-4, -3, 6.8, 4, 1, PLATE), brick(-4, 2, 6.8, 4, 1, PLATE)]
    beacon = creased(lathe([(0.0, 7.4), (0.36, 7.4), (0.36, 7.8), (0.26, 8.05), (0, 8.1)], 20)).moved(-3.5, 2.5)
    seat = merged([brick(-3.6, -1, 2.1, 2, 2, BRICK, False), brick(-3.9, -1, 3.3, 1, 2, BRICK, False)])
    column = rod((-0.6, 0, 2.1), (-1.0, 0, 4.0), 0.1, 10)
    turn = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    hoop = tube(np.c_[0 * turn, 0.42 * np.cos(turn), 0.42 * np.sin(turn)], 0.07, 8, closed=True)
    wheel = hoop.turned(-65, (0, 1, 0)).moved(-1.02, 0, 4.05)
    levers = [rod((-1.4, y, 2.1), (-1.1, y, 3.9), 0.06, 8) for y in (-1.1, 1.1)]
    knobs = [ball(0.13, 12).moved(-1.1, y, 3.9) for y in (-1.1, 1.1)]
    side = brick(-4, -2, 2.1, 4, 1, BRICK, False)
    return together(
        {"black": [merged([*pillars, *rails]), creased(merged([column, wheel, *levers]))]},
        {"yellow": [*roof, mirrored(side)], "amber": [beacon], "dark": [seat], "red": knobs},
        driver(),
    )


def driver() -> Parts:
    head = creased(lathe([(0, 4.75), (0.3, 4.75), (0.4, 4.87), (0.4, 5.3), (0.3, 5.42), (0, 5.42)], 24)).moved(-2.7)
    helmet = creased(lathe([(0.46, 5.2), (0.46, 5.4), (0.36, 5.62), (0.15, 5.72), (0, 5.74)], 24)).moved(-2.7)
    torso = prism([(-3.05, 3.4), (-2.35, 3.4), (-2.45, 4.7), (-2.95, 4.7)], -0.55, 0.55)
    arm = tube(np.array([(-2.7, 0.62, 4.5), (-2.4, 0.75, 4.1), (-1.5, 0.45, 4.1)]), 0.19, 10)
    hand = ball(0.2, 12).moved(-1.35, 0.42, 4.1)
    legs = merged([box(1.3, 0.5, 0.5).moved(-1.95, y, 3.55) for y in (-0.28, 0.28)])
    return {"yellow": [head, mirrored(hand)], "red": [torso, mirrored(creased(arm))], "blue": [legs], "grey": [helmet]}


def rear() -> Parts:
    block = [brick(-6, -2, 2.1, 2, 4, BRICK, False), brick(-6, -2, 3.3, 2, 4, PLATE)]
    slope = prism([(-7, 2.1), (-6.02, 2.1), (-6.02, 3.3), (-6.2, 3.3)], -2 + GAP, 2 - GAP)
    lamps = [creased(cylinder(0.28, 0.2, 18)).turned(-55, (0, 1, 0)).moved(-6.62, y, 2.82) for y in (-1.5, 1.5)]
    arc = np.linspace(-0.2, 1.9, 14)
    claw = strip(np.c_[-6.3 - 1.3 * np.sin(arc), 0.9 + 1.3 * np.cos(arc)][::-1], 0.24, -0.16, 0.16)
    arms = [rod((-5.8, y, 1.7), (-7.3, y, 1.8), 0.14, 10) for y in (-1.2, 1.2)]
    bar = rod((-7.3, -1.6, 1.8), (-7.3, 1.6, 1.8), 0.17, 12)
    return {
        "yellow": [*block, slope],
        "red": lamps,
        "dark": [creased(merged([*arms, bar])), *(claw.moved(y=y) for y in (-1.1, 0, 1.1))],
    }


def blade() -> Parts:
    """A concave shield with ribs behind, on pierced beams next to the tracks, lifted by two cylinders."""
    arc = np.radians(np.linspace(232, 136, 24))
    profile = np.c_[9.15 + 2.5 * np.cos(arc), 2.35 + 2.5 * np.sin(arc)]
    shield = strip(profile, 0.3, -5.2, 5.2)
    edge = prism([(7.3, 0.12), (7.9, 0.05), (7.75, 0.5), (7.45, 0.55)], -5.2, 5.2)
    ribs = [strip(profile[3:-3] - [0.2, 0.0], 0.35, y - 0.12, y + 0.12) for y in (-4.2, -2.1, 0, 2.1, 4.2)]
    rim = brick(6.7, -5, 4.05, 1, 10, PLATE)
    arms = mirrored(beam(10).turned(4, (0, 1, 0)).moved(-2.6, 5.1, 1.9))
    pin = creased(cylinder(0.27, 1.2, 16)).turned(90, (1, 0, 0))
    pins = mirrored(merged(pin.moved(-2.6 + 0.997 * hole, 4.9, 1.9 - 0.07 * hole) for hole in (0, 4)))
    low, high = np.array([6.15, 2.6, 3.0]), np.array([2.2, 2.6, 4.3])
    barrel = rod(high, high + 0.55 * (low - high), 0.3, 18)
    piston = rod(high + 0.5 * (low - high), low, 0.15, 14)
    eyes = merged([ball(0.34, 14).moved(*low), ball(0.36, 14).moved(*high)])
    return {
        "yellow": [shield, rim],
        "grey": [arms, edge, mirrored(creased(barrel))],
        "dark": [*ribs, pins, mirrored(eyes)],
        "chrome": [mirrored(creased(piston))],
    }


def build() -> Description:
    baseplate = {"sand": [brick(-8, -6, -PLATE, 16, 12, PLATE)]}
    model = together(baseplate, each(track(), mirrored), chassis(), engine(), cab(), rear(), blade())
    placed = each(model, lambda solid: solid.moved(z=-3.1).scaled(STUD))
    return {"type": "scene", "light": studio()} | meshes(placed, MATERIALS)


SCENE = Scene("lego", "Bulldozer of studded bricks: fine detail that shadows and hides itself", build, max_depth=8)
