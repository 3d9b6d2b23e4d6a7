"""The rig of the ship: masts, yards, sails, ropes."""

from dataclasses import dataclass

import numpy as np

from scenes.catalog.classics.ship_hull import MASTS_AT, STERN, WATER, channel, on_side
from scenes.modelling import surfaces
from scenes.modelling.parts import merged
from scenes.modelling.solids import Solid, between, lathe, sheet, smooth, tube


@dataclass(frozen=True)
class Mast:
    x: float
    foot: float
    top: float
    """The platform where the shrouds end."""
    head: float
    yards: tuple[tuple[float, float], ...]
    """The pairs (height, half-length) of each yard, lowest first."""
    set_sails: tuple[int, ...]
    """The indices of the yards whose sail is set; it reaches down to the yard below. The others are furled."""


FORE = Mast(MASTS_AT[0], -0.3, 0.12, 0.80, ((-0.03, 0.31), (0.31, 0.25), (0.60, 0.18)), (1, 2))
MAIN = Mast(MASTS_AT[1], -0.3, 0.18, 0.98, ((0.00, 0.36), (0.39, 0.29), (0.73, 0.20)), (1, 2))
MIZZEN = Mast(MASTS_AT[2], -0.2, 0.12, 0.66, ((0.12, 0.22), (0.43, 0.17)), (1,))
MASTS = (FORE, MAIN, MIZZEN)
BOWSPRIT = np.array([[0.50, 0.0, -0.20], [0.97, 0.0, 0.02]])
GAFF = np.array([[MIZZEN.x - 0.02, 0, 0.10], [MIZZEN.x - 0.32, 0, 0.24]])
BOOM = np.array([[MIZZEN.x - 0.02, 0, -0.13], [MIZZEN.x - 0.38, 0, -0.10]])


def spars() -> Solid:
    parts = []
    for mast in MASTS:
        line = np.array([at(mast, z) for z in (mast.foot - 0.1, mast.top, mast.top + 0.02, mast.head)])
        parts.append(tube(line, np.array([0.021, 0.017, 0.012, 0.005]), sides=12))
        parts += [spar(ends_of_yard(mast, yard), 0.011 - 0.0025 * yard) for yard in range(len(mast.yards))]
    parts += [spar(GAFF, 0.007), spar(BOOM, 0.008), tube(BOWSPRIT, np.array([0.019, 0.007]), sides=12)]
    return merged(smooth(part) for part in parts)


def tops() -> Solid:
    outline = [(0, 0), (0.045, 0.0), (0.062, 0.012), (0.062, 0.02), (0, 0.02)]
    return merged(lathe(outline, segments=24).moved(x=mast.x, z=mast.top) for mast in MASTS)


def spar(ends: np.ndarray, radius: float) -> Solid:
    t = np.linspace(0, 1, 9)
    return tube(between(ends[0], ends[1], t), radius * (1 - 0.5 * (2 * t - 1) ** 2), sides=8)


def ends_of_yard(mast: Mast, yard: int, ahead: float = 0.022) -> np.ndarray:
    """Return port and starboard end, braced round a little to the wind."""
    z, half = mast.yards[yard]
    brace = np.radians(14)
    reach = half * np.array([np.sin(brace), np.cos(brace), 0])
    return np.array([mast.x + ahead, 0, z]) + np.array([[1], [-1]]) * reach


def sail(corners: np.ndarray, belly: np.ndarray) -> Solid:
    """A cloth between four corners (head left, head right, foot left, foot right), blown out along `belly`."""
    u, v = np.meshgrid(np.linspace(0, 1, 17), np.linspace(0, 1, 15), indexing="ij")
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=-1)
    bulge = np.sin(np.pi * u) ** 0.7 * np.sin(np.pi * np.clip(v * 0.93, 0, 1)) ** 0.7
    # the foot is cut as an arch
    rise = 0.10 * (corners[0, 2] - corners[2, 2]) * np.sin(np.pi * u) * v**4
    points = weights @ corners + bulge[..., None] * belly + rise[..., None] * np.array([0, 0, 1.0])
    return sheet(points, np.stack([u, v], -1))


def sails() -> tuple[Solid, Solid]:
    spread, furled = [], []
    for mast in MASTS:
        for yard in range(len(mast.yards)):
            head = ends_of_yard(mast, yard, ahead=0.03)
            if yard in mast.set_sails:
                foot = ends_of_yard(mast, yard - 1, ahead=0.03) + np.array([0, 0, 0.02])
                corners = np.concatenate([narrowed(head, 0.92), narrowed(foot, 0.86)])
                spread.append(sail(corners, np.array([0.085, -0.02, 0])))
            else:
                furled.append(bundle(narrowed(head, 0.9), seed=yard + int(100 * mast.head)))
    (tack, clew), (throat, peak) = BOOM, GAFF
    aft = np.array([-0.015, 0, 0])
    spanker = np.array([throat + aft, peak, tack + aft, clew - 0.2 * aft])
    spread.append(sail(spanker, np.array([0.0, -0.05, 0])))
    for high, low, share in ((0.62, 0.95, 0.80), (0.36, 0.60, 0.75)):
        head = np.array([FORE.x + 0.02, 0, high])
        (nose,) = between(BOWSPRIT[0], BOWSPRIT[1], (low,))
        top, bottom = between(head, nose, (0.22, 0.94))
        clew_ = np.array([FORE.x + 0.12, -0.10, bottom[2] + 0.05])
        spread.append(sail(np.array([top, top, bottom, bottom + share * (clew_ - bottom)]), np.array([0.0, -0.04, 0])))
    return merged(spread), merged(furled)


def narrowed(ends: np.ndarray, share: float) -> np.ndarray:
    return np.asarray(ends.mean(axis=0) + share * (ends - ends.mean(axis=0)))


def bundle(ends: np.ndarray, seed: int) -> Solid:
    """A sail rolled up below its yard, pinched by its gaskets."""
    t = np.linspace(0, 1, 61)
    pinch = np.abs(np.sin(np.pi * 9 * t)) ** 0.5
    radius = (0.011 + 0.013 * pinch) * (1 - 0.45 * np.abs(2 * t - 1) ** 2)
    wobble = 0.002 * np.random.default_rng(seed).normal(size=(61, 3))
    return smooth(tube(between(ends[0], ends[1], t) + wobble - np.array([0, 0, 0.016]), radius, sides=10))


def canvas() -> np.ndarray:
    """Cream cloth with seams between its strips and reef bands across."""
    rows, columns = 128, 192
    cloth = surfaces.mixed((0.74, 0.66, 0.50), (0.86, 0.80, 0.66), surfaces.mottle(31, rows, columns, 1.1))
    seam = (np.arange(columns)[None] % 24 < 1) | (np.abs(np.arange(rows)[:, None] - 30) < 1)
    return np.where(seam[..., None], 0.7 * cloth, cloth)


def flag() -> Solid:
    u, v = np.meshgrid(np.linspace(0, 1, 17), np.linspace(0, 1, 5), indexing="ij")
    x = MAIN.x - 0.005 - 0.17 * u
    y = 0.03 * np.sqrt(u) * np.sin(9 * u) - 0.05 * u
    return sheet(np.stack([x, y, MAIN.head - 0.01 - 0.08 * v - 0.02 * u], -1))


def at(mast: Mast, z: float) -> np.ndarray:
    return np.array([mast.x, 0.0, z])


def rope(start: np.ndarray, end: np.ndarray, radius: float = 0.0032) -> Solid:
    return tube(np.array([start, end]), radius, sides=5)


def rigging() -> Solid:
    lines = [line for mast in MASTS for line in [*standing(mast), *braces(mast)]]
    nose = between(BOWSPRIT[0], BOWSPRIT[1], (0.6, 0.8, 0.98))
    stays = [
        (at(FORE, FORE.top), nose[0]),
        (at(FORE, 0.5), nose[1]),
        (at(FORE, FORE.head), nose[2]),
        (at(MAIN, MAIN.top), at(FORE, -0.22)),
        (at(MAIN, 0.62), at(FORE, FORE.top)),
        (at(MAIN, MAIN.head), at(FORE, 0.62)),
        (at(MIZZEN, MIZZEN.top), at(MAIN, -0.2)),
        (at(MIZZEN, MIZZEN.head), at(MAIN, MAIN.top)),
        (nose[2], np.array([0.66, 0, WATER + 0.06])),
        (GAFF[1], at(MIZZEN, 0.4)),
        (BOOM[1], at(MIZZEN, MIZZEN.top)),
    ]
    return merged([*lines, *(rope(*stay) for stay in stays)])


def standing(mast: Mast) -> list[Solid]:
    """The shrouds with their ratlines up to the top, then up to the topmast, and backstays."""
    lines = []
    for starboard in (True, False):
        feet = np.array([channel(mast.x - aft, starboard) for aft in np.linspace(-0.06, 0.07, 5)])
        lean = np.array([0.012, 0.05 if not starboard else -0.05, 0.0])
        tops = at(mast, mast.top) + np.linspace([0.02, 0, 0], [-0.02, 0, 0], 5) + 0.3 * lean
        lines += ladder(feet, tops, rungs=13)
        upper_feet = at(mast, mast.top + 0.015) + lean + np.linspace([0.01, 0, 0], [-0.035, 0, 0], 3)
        upper_tops = np.repeat([at(mast, mast.top + 0.62 * (mast.head - mast.top))], 3, axis=0)
        lines += ladder(upper_feet, upper_tops, rungs=9)
        lines.append(rope(at(mast, mast.head - 0.04), channel(mast.x - 0.10, starboard), 0.0026))
    return lines


def ladder(feet: np.ndarray, tops: np.ndarray, rungs: int) -> list[Solid]:
    """Shrouds from feet to tops, tied together by rungs across."""
    shrouds = [rope(foot, top) for foot, top in zip(feet, tops, strict=True)]
    shares = np.linspace(0, 1, rungs + 2)[1:-1]
    left, right = between(feet[0], tops[0], shares), between(feet[-1], tops[-1], shares)
    return shrouds + [rope(a, b, 0.0022) for a, b in zip(left, right, strict=True)]


def braces(mast: Mast) -> list[Solid]:
    """The ropes from the ends of each yard up to the mast (lifts) and aft to the rail or the next mast (braces)."""
    lines = []
    for yard, (z, _) in enumerate(mast.yards):
        for end, sign in zip(ends_of_yard(mast, yard), (1, -1), strict=True):
            lines.append(rope(end, at(mast, min(z + 0.16, mast.head)), 0.002))
            aft = max(mast.x - 0.33, STERN + 0.02)
            lines.append(rope(end, on_side(aft, 1.0, starboard=sign < 0), 0.002))
    return lines
