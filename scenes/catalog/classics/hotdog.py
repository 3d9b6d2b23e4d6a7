"""Two hot dogs with mustard on a white plate."""

from collections.abc import Callable

import numpy as np

from scenes.modelling import surfaces
from scenes.modelling.lighting import studio
from scenes.modelling.parts import merged
from scenes.modelling.scene import Description, Scene
from scenes.modelling.solids import Solid, lathe, loft, mesh, smooth

BUN_LENGTH = 1.42
BUN_WIDTH, BUN_HEIGHT = 0.27, 0.27
SAUSAGE_LENGTH, SAUSAGE_RADIUS = 1.66, 0.125
SAUSAGE_HEIGHT = 0.155
"""The height of the sausage's axis over the centre of the bun."""
BETWEEN = 0.37
PLATE_TOP = -0.21
BUN_CENTRE = PLATE_TOP + 0.185


def build() -> Description:
    # two along y, slightly turned so that they differ
    makers: list[Callable[[int], Solid]] = [bun, lambda side: sausage(), lambda side: mustard(1.3 * side)]
    buns, sausages, strands = (
        merged(make(side).turned(90 + 3 * side).moved(x=side * BETWEEN, z=BUN_CENTRE) for side in (-1, 1))
        for make in makers
    )
    return {
        "type": "scene",
        "light": studio(brightness=1.25),
        "plate": mesh(plate(), surfaces.plastic((0.66, 0.66, 0.65), roughness=0.08)),
        "buns": mesh(buns, surfaces.plastic(surfaces.texture(bread()), roughness=0.35)),
        "sausages": mesh(sausages, surfaces.plastic(surfaces.texture(skin()), roughness=0.14)),
        "mustard": mesh(strands, surfaces.plastic((0.93, 0.66, 0.03), roughness=0.1)),
    }


def plate() -> Solid:
    under = [(0, -0.03), (0.5, -0.03), (0.54, -0.055), (0.6, -0.055), (0.63, -0.03), (0.80, -0.018), (0.88, 0.05)]
    lip = [(0.96, 0.09), (1.17, 0.128), (1.197, 0.142), (1.205, 0.154), (1.197, 0.164), (1.17, 0.162)]
    slope = [(1.1, 0.148), (0.98, 0.124), (0.93, 0.108), (0.89, 0.08), (0.85, 0.036), (0.81, 0.012)]
    well = [(0.76, 0.002), (0.7, 0), (0, 0)]
    return smooth(lathe([*under, *lip, *slope, *well], segments=128).moved(z=PLATE_TOP))


def along(length: float, count: int) -> np.ndarray:
    """Places from −1 to 1 that crowd towards the ends, where a rounded body closes."""
    return np.sin(np.linspace(-np.pi / 2, np.pi / 2, count + 2))[1:-1] * (length / 2)


def bun(seed: int) -> Solid:
    """A puffy loaf along x with a deep cleft on top; u runs around it from the bottom."""
    angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    from_top = np.abs(angle - np.pi)
    cleft = np.exp(-((from_top / 0.52) ** 4))
    reach = 1 - 0.74 * cleft
    x = along(BUN_LENGTH, 72)
    share = 2 * np.abs(x) / BUN_LENGTH
    thickness = (1 - share**3.4) ** (1 / 2.2)
    swell = 1 + 0.035 * np.sin(5 * x[:, None] / BUN_LENGTH + 2 * seed + 2 * angle)
    across = np.sin(-angle) * BUN_WIDTH * reach * thickness[:, None] * swell * 1.14
    up = -np.cos(angle) * reach * swell
    up = np.where(up > 0, BUN_HEIGHT, 0.185) * up * thickness[:, None]
    rings = np.stack([np.broadcast_to(x[:, None], across.shape), -across, up], axis=-1)
    return smooth(loft(rings))


def bend(x: np.ndarray) -> np.ndarray:
    """Return the height of the sausage's axis, whose ends curl up."""
    return SAUSAGE_HEIGHT + 0.10 * (2 * x / SAUSAGE_LENGTH) ** 2


def sausage() -> Solid:
    angle = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    x = along(SAUSAGE_LENGTH, 80)
    radius = SAUSAGE_RADIUS * (1 - (2 * np.abs(x) / SAUSAGE_LENGTH) ** 9) ** 0.5
    across, up = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle) + bend(x)[:, None]
    return smooth(loft(np.stack([np.broadcast_to(x[:, None], across.shape), across, up], axis=-1)))


def mustard(phase: float) -> Solid:
    """A squeezed strand that winds along the top of the sausage, lying on its skin."""
    x = np.linspace(-0.41, 0.41, 241) * SAUSAGE_LENGTH
    wave = np.sin(2 * np.pi * 4.5 * x / SAUSAGE_LENGTH + phase)
    # lean is the angle around the sausage; the strand's middle line lies in its skin
    lean = 0.72 * wave
    path = np.stack([x, SAUSAGE_RADIUS * np.sin(lean), bend(x) + SAUSAGE_RADIUS * np.cos(lean)], axis=-1)
    ends = np.clip((np.abs(x[-1]) - np.abs(x)) / 0.03, 0, 1)
    radius = 0.036 * np.sqrt(1 - (1 - ends) ** 2).clip(0.12) * (1 + 0.1 * np.sin(31 * x + phase))
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    out = np.stack([np.zeros_like(x), np.sin(lean), np.cos(lean)], axis=-1)
    sideways = np.cross(tangent, out)
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)[:, None]
    across = np.cos(angle) * sideways[:, None] - np.sin(angle) * out[:, None]
    return smooth(loft(path[:, None] + radius[:, None, None] * across))


def bread() -> np.ndarray:
    """The colours of the crust, brownest on the shoulders, paler below, crumb in the cleft; rows go along the bun."""
    rows, columns = 128, 256
    from_top = np.abs(np.linspace(-1, 1, columns))[None] + 0.03 * (surfaces.mottle(3, rows, columns, 1.5) - 0.5)
    crumb = 1 / (1 + np.exp((from_top - 0.20) / 0.012))
    pale = 1 / (1 + np.exp(-(from_top - 0.72) / 0.06))
    crust = surfaces.mixed((0.60, 0.27, 0.075), (0.80, 0.48, 0.18), 0.8 * surfaces.mottle(4, rows, columns, 1.3))
    crust = crust + pale[..., None] * (np.array((0.80, 0.56, 0.28)) - crust)
    return np.asarray(crust + crumb[..., None] * (np.array((0.86, 0.68, 0.42)) - crust))


def skin() -> np.ndarray:
    return surfaces.mixed((0.36, 0.075, 0.028), (0.52, 0.14, 0.05), surfaces.mottle(5, 128, 128, 1.2))


SCENE = Scene("hotdog", "Two hot dogs on a plate: smooth, soft shapes and soft shadows", build)
