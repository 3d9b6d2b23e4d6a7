"""A weeping fig in a pot: hundreds of thin leaves."""

from dataclasses import dataclass

import numpy as np

from scenes.modelling import surfaces
from scenes.modelling.lighting import studio
from scenes.modelling.parts import merged
from scenes.modelling.scene import Description, Scene
from scenes.modelling.solids import Solid, lathe, mesh, sheet, smooth, tube

GOLDEN_ANGLE = np.pi * (3 - 5**0.5)
POT_BOTTOM, POT_HEIGHT = -1.17, 0.5
SOIL = POT_BOTTOM + POT_HEIGHT - 0.06
SHADES = 4
"""The number of kinds of green; each is one strip of the leaf texture."""
UP = np.array([0.0, 0.0, 1.0])


def build() -> Description:
    wood, leaves = grown()
    terracotta = surfaces.mixed((0.36, 0.12, 0.055), (0.48, 0.19, 0.09), surfaces.mottle(2, 128, 128, 1.2))
    earth = surfaces.mixed((0.025, 0.016, 0.01), (0.09, 0.06, 0.04), surfaces.mottle(3, 128, 128, 0.6))
    return {
        "type": "scene",
        "light": studio(brightness=1.3),
        "pot": mesh(pot(), surfaces.plastic(surfaces.texture(terracotta), roughness=0.25)),
        "soil": mesh(soil(), surfaces.matte(surfaces.texture(earth))),
        "wood": mesh(merged(wood), surfaces.matte((0.16, 0.11, 0.075))),
        "leaves": mesh(merged(leaves), surfaces.thin(surfaces.texture(leaf_colours()), 0.3, roughness=0.3)),
    }


def pot() -> Solid:
    outside = [(0, 0), (0.22, 0), (0.235, 0.006), (0.243, 0.02), (0.305, 0.355), (0.31, 0.362)]
    collar = [(0.345, 0.362), (0.352, 0.37), (0.362, 0.485), (0.357, 0.497), (0.345, 0.5), (0.325, 0.495)]
    inside = [(0.315, 0.48), (0.30, 0.40), (0, 0.40)]
    return smooth(lathe([*outside, *collar, *inside], segments=96).moved(z=POT_BOTTOM))


def soil() -> Solid:
    heap = [(0.314 * (1 - t), SOIL + 0.03 * t**0.7) for t in np.linspace(0, 1, 12)]
    return smooth(lathe([(0, SOIL - 0.02), (0.31, SOIL - 0.02), *heap], segments=64))


@dataclass(frozen=True)
class Order:
    """The look of the axes of one order of branching: the trunk's stems first, twigs last."""

    points: int
    sides: int
    bend: float
    """The wander of the direction from one point to the next."""
    lift: float
    """The pull up (positive) or droop (negative) from one point to the next."""
    children: int
    first_child: float
    """The share of the axis that stays bare."""
    spread: float
    """The angle between a child and its parent, radians."""
    shorter: float
    """The length of a child over that of its parent."""


ORDERS = (
    Order(points=22, sides=10, bend=0.065, lift=0.05, children=9, first_child=0.36, spread=0.95, shorter=0.46),
    Order(points=12, sides=7, bend=0.11, lift=0.03, children=6, first_child=0.22, spread=0.80, shorter=0.62),
    Order(points=9, sides=5, bend=0.14, lift=-0.10, children=8, first_child=0.10, spread=0.0, shorter=0.0),
)
STEMS = 3


def grown() -> tuple[list[Solid], list[Solid]]:
    """Return wood and leaves of stems that rise together out of the soil and lean apart."""
    random = np.random.default_rng(3)
    wood: list[Solid] = []
    leaves: list[Solid] = []

    def grow(start: np.ndarray, direction: np.ndarray, length: float, radius: float, order: int) -> None:
        habit = ORDERS[order]
        path = wander(random, start, direction, length, habit)
        taper = radius * np.linspace(1.0, 0.35, habit.points)
        wood.append(smooth(tube(path, taper, habit.sides)))
        turn = random.uniform(0, 2 * np.pi)
        for child, share in enumerate(np.linspace(habit.first_child, 1.0, habit.children)):
            place = share * (habit.points - 1)
            index = min(int(place), habit.points - 2)
            point = path[index] + (place - index) * (path[index + 1] - path[index])
            along = unit(path[index + 1] - path[index])
            around = turn + child * GOLDEN_ANGLE
            if order + 1 == len(ORDERS):
                leaves.append(leaf_at(random, point, along, around, tip=child + 1 == habit.children))
            else:
                leave = habit.spread * (1.0 if share < 1 else 0.35) * random.uniform(0.85, 1.15)
                outward = np.cos(leave) * along + np.sin(leave) * sideways(along, around)
                size = length * habit.shorter * (1.15 - 0.45 * share) * random.uniform(0.85, 1.15)
                grow(point, outward, size, max(0.45 * taper[index], 0.005), order + 1)

    for stem in range(STEMS):
        around = 2 * np.pi * stem / STEMS + 0.4
        outward = np.array([np.cos(around), np.sin(around), 0.0])
        foot = np.array([0.0, 0.0, SOIL]) + 0.055 * outward
        grow(foot, UP + 0.15 * outward, length=1.42 - 0.12 * stem, radius=0.034, order=0)
    return wood, leaves


def wander(
    random: np.random.Generator, start: np.ndarray, direction: np.ndarray, length: float, habit: Order
) -> np.ndarray:
    """A path that changes its direction a little at each step."""
    path, heading = [start], unit(direction)
    for _ in range(habit.points - 1):
        heading = unit(heading + habit.bend * random.normal(size=3) + habit.lift * UP)
        path.append(path[-1] + heading * length / (habit.points - 1))
    return np.array(path)


def unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))


def sideways(along: np.ndarray, angle: float) -> np.ndarray:
    first = unit(np.cross(along, np.eye(3)[np.argmin(np.abs(along))]))
    return np.asarray(np.cos(angle) * first + np.sin(angle) * np.cross(along, first))


def leaf_at(random: np.random.Generator, point: np.ndarray, twig: np.ndarray, around: float, tip: bool) -> Solid:
    """A leaf on its stalk; it points away from the twig, hangs a little and turns its face up."""
    away = twig if tip else 0.55 * twig + sideways(twig, around)
    ahead = unit(unit(away) - random.uniform(0.15, 0.7) * UP)
    side = np.cross(UP + 0.45 * random.normal(size=3), ahead)
    side = unit(side - ahead * (side @ ahead))
    frame = np.eye(4)
    frame[:3, :3] = np.stack([ahead, side, np.cross(ahead, side)], axis=1) * random.uniform(0.12, 0.18)
    frame[:3, 3] = point
    shape = leaf(curl=random.uniform(0.05, 0.45), fold=random.uniform(0.1, 0.4), shade=int(random.integers(SHADES)))
    return shape.transformed(frame)


def leaf(curl: float, fold: float, shade: int) -> Solid:
    """A leaf of unit length along x, facing z: stalk, oval blade, drip tip; `uv` along and across it in its shade."""
    x = np.array([0.0, 0.10, 0.14, 0.2, 0.28, 0.38, 0.5, 0.62, 0.73, 0.82, 0.9, 1.0])
    blade = np.clip((x - 0.10) / 0.90, 0, 1)
    half_width = 0.012 * (1 - blade) + 0.232 * np.sin(np.pi * blade**0.8) ** 0.85 * (1 - 0.55 * blade**3)
    across = np.array([-1.0, -0.55, 0.0, 0.55, 1.0])
    y = half_width[:, None] * across
    z = fold * np.abs(y) - curl * blade[:, None] ** 2
    u = (shade + 0.5 + 0.46 * across) / SHADES
    uv = np.stack(np.broadcast_arrays(u, x[:, None]), axis=-1)
    return sheet(np.stack([np.broadcast_to(x[:, None], y.shape), y, z], axis=-1), uv)


def leaf_colours() -> np.ndarray:
    """Strips side by side, one per shade, from stalk to tip along the rows: blade, paler midrib and side veins."""
    rows, columns = 128, 64
    across = np.abs(np.linspace(-1, 1, columns))[None]
    along = np.linspace(0, 1, rows)[:, None]
    midrib = np.exp(-((across / 0.07) ** 2))
    veins = np.exp(-((((along * 9 - across * 0.9) % 1.0 - 0.5) / 0.1) ** 2)) * 0.35
    share = np.clip(midrib + veins, 0, 1)
    greens = ((0.075, 0.24, 0.035), (0.10, 0.30, 0.045), (0.15, 0.38, 0.055), (0.05, 0.18, 0.03))
    return np.concatenate([surfaces.mixed(green, (0.30, 0.46, 0.14), 0.6 * share) for green in greens], axis=1)


SCENE = Scene(
    "ficus", "A potted weeping fig, seen from all around: hundreds of thin leaves that hide each other", build, "sphere"
)
