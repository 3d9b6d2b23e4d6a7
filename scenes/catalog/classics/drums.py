"""A drum kit: lacquered shells with see-through skins, brass cymbals, chrome hardware on thin stands."""

import numpy as np

from scenes.modelling import surfaces
from scenes.modelling.lighting import studio
from scenes.modelling.parts import Parts, around, each, merged, meshes, mirrored, together
from scenes.modelling.scene import Description, Scene
from scenes.modelling.solids import Solid, ball, box, cylinder, lathe, rod, rounded_box, spline, tube

FLOOR = -0.86


def placed(kit: Parts, place: np.ndarray) -> Parts:
    return each(kit, lambda solid: solid.transformed(place))


def pose(at: tuple[float, float, float], tilt: float = 0.0, azimuth: float = 0.0) -> np.ndarray:
    """Tip the local z by `tilt` degrees towards the azimuth, then move it there."""
    t, a = np.radians([tilt, azimuth])
    about_y = np.array([[np.cos(t), 0, np.sin(t)], [0, 1, 0], [-np.sin(t), 0, np.cos(t)]])
    about_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = about_z @ about_y @ about_z.T, at
    return matrix


def pipe(outer: float, inner: float, low: float, high: float) -> Solid:
    return lathe([(inner, low), (outer, low), (outer, high), (inner, high), (inner, low)], 64)


def skin(radius: float, z: float) -> Solid:
    return lathe([(radius, z), (0.7 * radius, z), (0.0, z)], 64)


def drum(radius: float, depth: float, lugs: int, shell: str, top: str, bottom: str) -> Parts:
    """A drum centred at the origin, its axis z: shell, hoops, tension rods with lugs, two skins."""
    half = depth / 2
    hoop = merged(pipe(radius + 0.022, radius + 0.004, s * half - 0.02, s * half + 0.02) for s in (-1, 1))
    rods = merged(rod((radius + 0.016, 0, s * 0.25 * half), (radius + 0.016, 0, s * half), 0.0065, 8) for s in (-1, 1))
    lug = rounded_box(0.03, 0.034, min(0.13, 0.5 * depth), 0.012).moved(radius + 0.012)
    return {
        shell: [pipe(radius, radius - 0.018, -half, half)],
        "chrome": [hoop, around(merged([rods, lug]), lugs)],
        top: [skin(radius, half)],
        bottom: [skin(radius, half).turned(180, (1, 0, 0))],
    }


def cymbal(radius: float) -> Solid:
    """A bronze plate: bell, shallow bow, fine grooves; thin but closed."""
    r = np.linspace(1.0, 0.0, 60)
    bow = 0.10 * radius * (1 - r**2) + 0.10 * radius * np.exp(-((r / 0.17) ** 4))
    groove = 0.0012 * np.sin(r * 95) * (r > 0.24) * (r < 0.97)
    above = np.c_[r * radius, bow + groove + 0.004]
    below = np.c_[r[::-1] * radius, bow[::-1] - 0.004]
    return lathe([tuple(point) for point in np.vstack([below, above])], 72)


def tripod(height: float, spread: float = 0.26) -> Parts:
    """A stand of this height on the origin: three braced legs, a telescoping pole, wing nuts, rubber feet."""
    brace = rod((0, 0, 0.14), (0.55 * spread, 0, 0.145), 0.008, 8)
    leg = merged([rod((0, 0, 0.30), (spread, 0, 0.015), 0.011, 8), brace])
    foot = ball(0.022, 12).moved(spread, 0, 0.018)
    lower, upper = (0.08, 0.58 * height, 0.016), (0.5 * height, height, 0.0105)
    pole = merged(rod((0, 0, low), (0, 0, high), radius, 12) for low, high, radius in (lower, upper))
    collar = merged([cylinder(0.026, 0.05, 16).moved(z=z) for z in (0.29, 0.58 * height)])
    wing = rounded_box(0.012, 0.06, 0.022, 0.005).moved(0.03, 0, 0.58 * height)
    return {"chrome": [around(leg, 3), pole, collar, wing], "rubber": [around(foot, 3)]}


def cymbal_on_boom(
    at: tuple[float, float, float], radius: float, tilt: float, azimuth: float, foot: tuple[float, float]
) -> Parts:
    """A stand that rises at `foot`, some way off, with a counterweighted boom that reaches over to the plate."""
    hub = 0.2 * radius
    plate: Parts = {
        "bronze": [cymbal(radius)],
        "felt": [cylinder(0.022, 0.022, 16).moved(z=hub + 0.015)],
        "chrome": [rod((0, 0, -0.08), (0, 0, hub + 0.05), 0.008, 8), ball(0.016, 10).moved(z=hub + 0.05)],
    }
    place = pose(at, tilt, azimuth)
    end = (place @ [0, 0, -0.08, 1])[:3]
    joint = np.array([*foot, at[2] - 0.22])
    back = joint - 0.45 * (end - joint)
    boom = [rod(back, end, 0.0095, 10), ball(0.018, 12).moved(*end), cylinder(0.03, 0.045, 16).moved(*joint)]
    weight = rod(back, back + 0.3 * (joint - back), 0.026, 14)
    stand = placed(tripod(joint[2] - FLOOR), pose((*foot, FLOOR)))
    return together(placed(plate, place), stand, {"chrome": boom, "steel": [weight]})


def hi_hat(x: float, y: float, z: float, radius: float) -> Parts:
    pair = [cymbal(radius).moved(z=0.014), cymbal(radius).scaled(1, 1, -1).moved(z=-0.014)]
    top: Parts = {
        "bronze": pair,
        "chrome": [rod((0, 0, -0.1), (0, 0, 0.28), 0.007, 8), cylinder(0.02, 0.05, 16).moved(z=0.2 * radius + 0.05)],
        "felt": [cylinder(0.024, 0.016, 16).moved(z=0.2 * radius + 0.02)],
    }
    pedal: Parts = {"steel": [rounded_box(0.26, 0.09, 0.016, 0.007).turned(-14, (0, 1, 0)).moved(-0.16, 0, 0.05)]}
    return together(placed(top, pose((x, y, z))), placed(together(tripod(z - FLOOR), pedal), pose((x, y, FLOOR))))


def bass_drum() -> Parts:
    """The bass drum on its side, front to +x: hoops with claws, a printed translucent skin, spurs, a pedal behind."""
    radius, depth = 0.44, 0.46
    body = drum(radius, depth, 10, "shell", "front", "clear")
    hoops = merged(pipe(radius + 0.034, radius, s * depth / 2 - 0.024, s * depth / 2 + 0.024) for s in (-1, 1))
    claw = rounded_box(0.02, 0.04, 0.065, 0.008)
    claws = around(merged(claw.moved(radius + 0.036, 0, s * depth / 2) for s in (-1, 1)), 10)
    # the print: two rings and a star
    rings = [lathe([(b, 0), (a, 0)], 64) for a, b in ((0.385, 0.405), (0.20, 0.235))]
    star = [box(0.075, 0.30, 0.002).turned(angle) for angle in (0, 60, 120)]
    badge = merged([*rings, *star]).moved(z=depth / 2 + 0.004)
    kit = together(body, {"hoop": [hoops], "chrome": [claws], "print": [badge]})
    kit = placed(kit, pose((0.10, 0, FLOOR + radius + 0.05), 90, 0))
    spur = tube(spline([(0.22, 0.40, -0.55), (0.27, 0.54, -0.68), (0.36, 0.60, FLOOR + 0.02)], 12), 0.013, 8)
    plate = rounded_box(0.30, 0.10, 0.018, 0.008).turned(-12, (0, 1, 0)).moved(-0.36, 0, FLOOR + 0.06)
    frame = merged([rod((-0.22, s * 0.06, FLOOR + 0.01), (-0.22, s * 0.06, FLOOR + 0.30), 0.011, 8) for s in (-1, 1)])
    axle = rod((-0.22, -0.08, FLOOR + 0.29), (-0.22, 0.08, FLOOR + 0.29), 0.01, 8)
    beater = rod((-0.22, 0, FLOOR + 0.29), (-0.19, 0, FLOOR + 0.50), 0.008, 8)
    head = ball(1.0, 16).scaled(0.03, 0.042, 0.042).moved(-0.185, 0, FLOOR + 0.51)
    return together(kit, {"chrome": [mirrored(spur), frame, axle, beater], "steel": [plate], "felt": [head]})


def rack_toms() -> Parts:
    toms = [
        placed(drum(r, d, 6, "shell", "frosted", "clear"), pose((0.10, s * 0.245, 0.31), 24, 180 + s * 12))
        for s, r, d in ((1, 0.185, 0.22), (-1, 0.205, 0.25))
    ]
    post = rod((0.11, 0, 0.0), (0.11, 0, 0.30), 0.022, 12)
    arms = mirrored(tube(spline([(0.11, 0, 0.27), (0.11, 0.03, 0.29), (0.11, 0.06, 0.29)], 8), 0.014, 10))
    foot = rounded_box(0.10, 0.07, 0.04, 0.012).moved(0.11, 0, 0.055)
    return together(*toms, {"chrome": [post, arms, foot, ball(0.036, 14).moved(0.11, 0, 0.29)]})


def floor_tom() -> Parts:
    radius, depth, middle = 0.245, 0.42, -0.36
    kit = drum(radius, depth, 8, "shell", "frosted", "clear")
    near, far = radius + 0.03, radius + 0.07
    bend = [(near, 0, 0.14), (near, 0, -0.20), (far, 0, -0.30), (far, 0, FLOOR - middle + 0.02)]
    legs = around(tube(spline(bend, 14), 0.011, 8), 3)
    feet = around(ball(0.022, 10).moved(radius + 0.07, 0, FLOOR - middle + 0.022), 3)
    return placed(together(kit, {"chrome": [legs], "rubber": [feet]}), pose((-0.42, -0.64, middle), 4, 60))


def snare() -> Parts:
    x, y, z = -0.50, 0.40, -0.22
    kit = placed(drum(0.225, 0.14, 8, "steel", "coated", "clear"), pose((x, y, z), 5, 200))
    arm = tube(spline([(0, 0, -0.20), (0.13, 0, -0.13), (0.235, 0, -0.07), (0.24, 0, -0.03)], 12), 0.011, 8)
    basket = around(arm, 3).moved(x, y, z)
    return together(kit, placed(tripod(0.46, 0.22), pose((x, y, FLOOR))), {"chrome": [basket]})


def throne() -> Parts:
    seat = lathe([(0, -0.05), (0.17, -0.05), (0.195, -0.03), (0.2, 0.0), (0.19, 0.03), (0.15, 0.045), (0, 0.05)], 48)
    stand = placed(tripod(0.48, 0.20), pose((-0.86, -0.08, FLOOR)))
    return together(stand, {"leather": [seat.moved(-0.86, -0.08, FLOOR + 0.50)]})


def sparkle(pixels: int = 256) -> np.ndarray:
    rng = np.random.default_rng(5)
    flakes = rng.random((pixels, pixels, 1)) ** 6
    colour = np.array(surfaces.srgb("#b01020")) * (0.8 + 0.4 * rng.random((pixels, pixels, 1)))
    return np.asarray(np.clip(colour + flakes * np.array([0.55, 0.2, 0.12]), 0, 1))


MATERIALS: dict[str, Description] = {
    "shell": surfaces.plastic(surfaces.texture(sparkle(), repeat=2.0), surfaces.VARNISH),
    "hoop": surfaces.plastic(surfaces.srgb("#2a1a14"), surfaces.VARNISH),
    "chrome": surfaces.metal("aluminium", 0.1),
    "steel": surfaces.metal("aluminium", 0.18),
    "bronze": surfaces.metal("bronze", 0.17),
    "rubber": surfaces.plastic(surfaces.BLACK_RUBBER, surfaces.RUBBER),
    "leather": surfaces.plastic((0.02, 0.02, 0.022), 0.3),
    "felt": surfaces.cloth((0.6, 0.57, 0.5), sheen=1.0),
    "print": surfaces.both_sides(surfaces.matte(surfaces.srgb("#141418"))),
    "front": surfaces.veil(0.55, surfaces.both_sides(surfaces.plastic((0.75, 0.74, 0.70), 0.15))),
    "frosted": surfaces.veil(0.45, surfaces.both_sides(surfaces.plastic((0.78, 0.78, 0.76), 0.1))),
    "coated": surfaces.both_sides(surfaces.matte((0.72, 0.71, 0.68))),
    "clear": surfaces.pane(),
}


def build() -> Description:
    kit = together(
        bass_drum(),
        rack_toms(),
        floor_tom(),
        snare(),
        throne(),
        hi_hat(-0.36, 0.83, 0.10, 0.19),
        cymbal_on_boom((0.16, 0.60, 0.62), 0.27, 14, 215, foot=(0.34, 0.72)),
        cymbal_on_boom((0.00, -0.66, 0.48), 0.32, 14, 140, foot=(0.26, -0.78)),
        cymbal_on_boom((0.34, -0.10, 0.78), 0.20, 16, 180, foot=(0.50, -0.42)),
    )
    centred = each(kit, lambda solid: solid.moved(x=0.14, y=-0.02, z=0.02).scaled(0.96))
    return {"type": "scene", "light": studio()} | meshes(centred, MATERIALS)


SCENE = Scene("drums", "Drum kit: see-through skins, brass cymbals, chrome on thin stands", build, max_depth=10)
