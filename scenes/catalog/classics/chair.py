"""An armchair: damask in green and gold on a carved, varnished frame with thin curved legs."""

from dataclasses import replace

import numpy as np

from scenes.modelling import surfaces
from scenes.modelling.lighting import studio
from scenes.modelling.parts import each, merged, meshes, mirrored
from scenes.modelling.scene import Description, Scene
from scenes.modelling.solids import Solid, ball, lathe, loft, rod, smooth, spline, tube

GREEN, GOLD = surfaces.srgb("#2f6b45"), surfaces.srgb("#dcb75c")


def damask(pixels: int = 512) -> np.ndarray:
    """Draw one repeat of the cloth: staggered gold palmettes and rosettes in an ogee lattice, with a visible weave."""
    rng = np.random.default_rng(11)
    u, v = np.meshgrid(*[(np.arange(pixels) + 0.5) / pixels] * 2, indexing="xy")
    gold = np.zeros((pixels, pixels))
    # one motif in the middle and the same at the four corners
    for cu, cv in ((0.5, 0.5), (0, 0), (0, 1), (1, 0), (1, 1)):
        x, y = (u - cu) * 2.0, (v - cv) * 2.0
        radius, angle = np.hypot(x, y), np.arctan2(y, x)
        petals = 0.34 + 0.15 * np.abs(np.cos(3 * angle)) ** 0.7
        gold = np.maximum(gold, (radius < petals) & (radius > petals - 0.10))
        gold = np.maximum(gold, (radius < 0.21 + 0.07 * np.cos(6 * angle)) & (radius > 0.08))
        for side in (-1.0, 1.0):
            leaf = np.hypot((x - side * (0.5 + 0.25 * y * y)) / 0.11, y / 0.34) < 1
            gold = np.maximum(gold, leaf & (np.abs(x - side * (0.5 + 0.25 * y * y)) > 0.02))
            bud = np.hypot(x / 0.10, (y - side * 0.66) / 0.15) < 1
            gold = np.maximum(gold, bud)
    thread = 0.5 + 0.25 * np.sin(2 * np.pi * u * 64) + 0.25 * np.sin(2 * np.pi * v * 64)
    shade = (0.82 + 0.18 * thread) * rng.normal(1.0, 0.04, thread.shape)
    colour = np.where(gold[..., None] > 0, GOLD, GREEN) * shade[..., None]
    return np.clip(colour, 0, 1)


def padded(outline: np.ndarray, thickness: float, dome: float, rings: int = 14) -> Solid:
    """Make a cushion over an outline [M, 2] in the plane: a rounded side, then a dome; `uv` as the cloth lies."""
    turn = np.linspace(0.0, 1.0, rings)
    side = [(1.0 - 0.06 * (1 - np.sin(a)), thickness * 0.5 * (np.sin(a))) for a in np.linspace(-1.4, 0.6, 6)]
    top = [(side[-1][0] * np.cos(t * np.pi / 2), side[-1][1] + dome * np.sin(t * np.pi / 2) ** 0.9) for t in turn[1:-1]]
    centre = outline.mean(axis=0)
    layers = [np.c_[centre + (outline - centre) * scale, np.full(len(outline), z)] for scale, z in side + top]
    solid = loft(np.array(layers))
    return smooth(replace(solid, uv=solid.vertices[:, :2]))


def leaning(solid: Solid) -> Solid:
    """Move from the drawing plane of the back (x right, y up, z to the front) to its place: tilted, hollow."""
    x, y, z = solid.vertices.T
    placed = np.stack([-0.40 - 0.24 * y + 0.22 * x**2 + z, x, 0.40 + 0.97 * y], axis=-1)
    return smooth(Solid(placed, solid.faces, solid.uv))


def back_outline(count: int = 96) -> np.ndarray:
    """A cartouche, counter-clockwise: narrow waist, swelling shoulders, a raised crest."""
    half = [(0.0, -0.50), (0.22, -0.49), (0.36, -0.42), (0.385, -0.25), (0.42, 0.0), (0.475, 0.25), (0.45, 0.44)]
    half += [(0.33, 0.54), (0.20, 0.56), (0.10, 0.61)]
    return spline([*half, (0.0, 0.64)] + [(-x, y) for x, y in reversed(half[1:])], count, closed=True)


def seat_outline(count: int = 96) -> np.ndarray:
    """Bow front, narrower at the back; x to the front."""
    half = [(0.50, 0.0), (0.49, 0.22), (0.44, 0.44), (0.33, 0.53), (0.0, 0.51), (-0.30, 0.44), (-0.42, 0.36)]
    return spline(half + [(-0.44, 0.0)] + [(x, -y) for x, y in reversed(half[1:])], count, closed=True)


def along(path: np.ndarray, solid: Solid) -> Solid:
    return merged(solid.moved(*point) for point in path)


def carved_back() -> Solid:
    outline = np.c_[back_outline(), np.zeros(96)]
    rim = outline * [1.06, 1.05, 1]
    frame = [tube(rim, 0.042, 10, closed=True), tube(outline + np.array([0, 0, 0.03]), 0.018, 8, closed=True)]
    beads = along(rim[::2] + np.array([0, 0, 0.038]), ball(0.017, 8))
    lobes = [
        ball(1.0, 12).scaled(0.025, 0.085, 0.03).moved(0, 0.075).turned(angle).moved(0, 0.64, 0.015)
        for angle in np.linspace(-80, 80, 7)
    ]
    # spirals that curl inwards
    t = np.linspace(0, 1, 28)
    radius, angle = 0.075 * (1 - 0.8 * t), np.pi + 2 * np.pi * 1.3 * t
    curl = np.c_[0.33 + radius * np.cos(angle), 0.60 + radius * np.sin(angle), np.full(28, 0.01)]
    scrolls = [tube(curl * [side, 1, 1], np.linspace(0.028, 0.014, 28), 8) for side in (-1, 1)]
    return leaning(merged([*frame, beads, *lobes, *scrolls, ball(0.045, 14).moved(0, 0.64, 0.025)]))


def front_leg() -> Solid:
    bend = [(0.37, 0.43, -0.27), (0.46, 0.50, -0.42), (0.44, 0.485, -0.65), (0.385, 0.44, -0.88), (0.43, 0.48, -1.0)]
    radius = np.interp(np.linspace(0, 1, 36), [0, 0.22, 0.5, 0.82, 0.93, 1], [0.075, 0.085, 0.046, 0.028, 0.04, 0.05])
    foot = ball(0.055, 16).moved(0.445, 0.495, -1.005)
    sole = lathe([(0, -1.06), (0.04, -1.06), (0.04, -1.03), (0, -1.03)]).moved(0.445, 0.495)
    leaf = ball(1.0, 10).scaled(0.016, 0.016, 0.06)
    knee = [leaf.turned(a, (1, -1, 0)).moved(0.507, 0.547, -0.40 - abs(a) * 4e-4) for a in (-25, 0, 25)]
    return merged([tube(spline(bend, 36), radius, 14), foot, sole, *knee])


def back_leg() -> Solid:
    leg = [(-0.60, 0.40, -1.06), (-0.47, 0.385, -0.75), (-0.40, 0.38, -0.35)]
    bend = [*leg, (-0.375, 0.39, -0.05), (-0.35, 0.40, 0.12)]
    return tube(spline(bend, 30), np.interp(np.linspace(0, 1, 30), [0, 0.5, 1], [0.032, 0.052, 0.036]), 12)


def arm() -> Solid:
    """An arm, swept from the back outwards to a scroll, on a support that leans back from the seat rail."""
    reach = [(-0.37, 0.45, 0.28), (-0.15, 0.55, 0.235), (0.12, 0.60, 0.20), (0.30, 0.60, 0.185)]
    s, a = np.linspace(1, 0.3, 9), np.linspace(0.2, 8.4, 9)
    curl = np.c_[0.34 + 0.065 * s * np.sin(a), np.full(9, 0.60), 0.12 + 0.065 * s * np.cos(a)]
    support = spline([(0.30, 0.51, -0.27), (0.34, 0.565, -0.12), (0.22, 0.60, 0.03), (0.24, 0.60, 0.17)], 22)
    leaf = ball(1.0, 10).scaled(0.02, 0.02, 0.09).turned(20, (0, 1, 0)).moved(0.325, 0.585, -0.08)
    knobs = [ball(0.03, 12).moved(0.335, y, 0.12) for y in (0.635, 0.565)]
    wood = [tube(spline(reach, 24), 0.036, 12), tube(spline(curl, 26), np.linspace(0.036, 0.016, 26), 10)]
    return merged([*wood, tube(support, np.linspace(0.046, 0.028, 22), 12), leaf, *knobs])


def arm_pad() -> Solid:
    pad = ball(1.0, 24).scaled(0.20, 0.058, 0.046).turned(-7.5, (0, 0, -1)).turned(8, (0, 1, 0))
    pad = pad.moved(-0.02, 0.578, 0.243)
    return replace(pad, uv=pad.vertices[:, :2])


def apron() -> Solid:
    """The rail below the seat with a scalloped lower edge and a rosette at the front, moulding above."""
    outline = seat_outline()
    angle = np.arctan2(outline[:, 1], outline[:, 0])
    drop = -0.37 - 0.035 * np.cos(6 * angle)
    levels = [(0.965, drop), (1.0, drop + 0.008)]
    levels += [(scale, np.full(96, z)) for scale, z in ((1.0, -0.27), (1.03, -0.262), (1.03, -0.235), (0.99, -0.225))]
    body = loft(np.array([np.c_[outline * scale, z] for scale, z in levels]))
    petal = ball(1.0, 10).scaled(0.018, 0.022, 0.05).moved(0, 0, 0.055)
    petals = [petal.turned(angle, (1, 0, 0)) for angle in range(0, 360, 45)]
    rosette = merged([*petals, ball(0.028, 12)]).moved(0.505, 0, -0.33)
    edge = tube(np.c_[outline * 0.995, drop], 0.014, 8, closed=True)
    return merged([body, rosette, edge])


def stretcher() -> Solid:
    side = rod((0.41, 0.455, -0.72), (-0.46, 0.385, -0.75), 0.02, 10)
    bulb = ball(1.0, 14).scaled(0.10, 0.034, 0.034).moved(-0.02, 0.42, -0.735)
    cross = rod((-0.02, -0.42, -0.735), (-0.02, 0.42, -0.735), 0.02, 10)
    finial = ball(0.045, 14).moved(-0.02, 0, -0.735)
    return merged([mirrored(merged([side, bulb])), cross, finial])


def build() -> Description:
    carving = merged([carved_back(), mirrored(merged([front_leg(), back_leg(), arm()])), apron(), stretcher()])
    seat = padded(seat_outline() * 0.985, 0.13, 0.115).moved(z=-0.17)
    seat = replace(seat, uv=seat.vertices[:, 1::-1])  # the pattern points to the back
    front = leaning(padded(back_outline() * 1.01, 0.07, 0.075))
    rear = leaning(padded(back_outline()[::-1] * [-1.02, 1.02], 0.05, 0.03).turned(180, (0, 1, 0)))
    nail = ball(0.0125, 8)  # brass nails along the edges of the cloth
    nails = [
        along(np.c_[seat_outline(72), np.full(72, -0.208)], nail),
        leaning(along(np.c_[back_outline(72) * [0.955, 0.955], np.full(72, 0.05)], nail)),
    ]
    cloth = [seat, front, rear, arm_pad(), arm_pad().scaled(1, -1, 1)]
    parts = {"frame": [carving], "cloth": cloth, "nails": [merged(nails)]}
    centred = each(parts, lambda solid: solid.moved(x=0.05, z=-0.05).scaled(0.97, 1.06, 0.935))
    materials = {
        "frame": surfaces.plastic(surfaces.srgb("#8a4a20"), surfaces.VARNISH),
        "cloth": surfaces.cloth(surfaces.texture(damask(), repeat=2.2)),
        "nails": surfaces.metal("brass", 0.14),
    }
    return {"type": "scene", "light": studio()} | meshes(centred, materials)


SCENE = Scene("chair", "Armchair: patterned cloth, carved varnish, thin curved legs", build)
