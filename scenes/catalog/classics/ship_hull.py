"""The hull of the ship: planking, deck and fittings. The bow points along x."""

import itertools

import numpy as np

from scenes.modelling import surfaces
from scenes.modelling.parts import merged
from scenes.modelling.solids import Solid, ball, box, loft, tube

WATER = -0.40
KEEL = WATER - 0.11
STERN, BOW = -0.64, 0.60
STEPS = (0.36, -0.22, -0.45)
"""The stations where the deck steps: to the forecastle, the quarterdeck, the poop."""
MASTS_AT = (0.33, -0.04, -0.41)
BEAM = 0.185
STRAKES = 25
"""The number of points of a cross-section from the keel to the rail; deck and bulwark add three."""
SHEER = 0.8
"""The share of the girth of the side below the sheer line."""
TAR, OCHRE, DECK = (0.035, 0.03, 0.028), (0.62, 0.42, 0.13), (0.42, 0.29, 0.16)


def sheer(x: np.ndarray) -> np.ndarray:
    """Return the height of the smooth line along the side, above which the bulwark steps up with the decks."""
    return np.asarray(WATER + 0.105 + np.where(x < 0, 0.26, 0.16) * x**2)


def deck(x: np.ndarray) -> np.ndarray:
    """Return the height of the deck: waist, forecastle ahead, quarterdeck and poop aft."""
    forecastle, quarterdeck, poop = STEPS
    return np.asarray(sheer(x) - 0.02 + 0.05 * (x > forecastle) + 0.06 * (x < quarterdeck) + 0.055 * (x < poop))


def half_breadth(x: np.ndarray) -> np.ndarray:
    """Return half the breadth of the deck: full aft with a flat stern, pointed at the bow."""
    ahead = np.clip((x - 0.08) / (BOW - 0.08), 0, 1)
    behind = np.clip((0.0 - x) / (0.0 - STERN), 0, 1)
    return BEAM * np.sqrt(np.clip(1 - ahead**2.4, 0, 1)) * (1 - 0.36 * behind**2) + 0.004


def stations() -> np.ndarray:
    """Return x of the cross-sections: two close together at each step of the deck."""
    steps = [step + side for step in STEPS for side in (-0.002, 0.002)]
    bow = BOW - 0.18 * np.linspace(1, 0, 28) ** 2
    return np.unique(np.concatenate([np.linspace(STERN, 0.4, 44), bow, steps, [STERN + 0.012]]))


def side(x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the point of the starboard side (y < 0) at station x [N], t from the keel (0) to the gunwale (1) [M]."""
    x, t = x[:, None], t[None]
    fore = np.clip((x - 0.05) / (BOW - 0.05), 0, 1)
    aft = np.clip((-0.2 - x) / (-0.2 - STERN), 0, 1)
    fullness = 0.30 + 0.55 * fore**1.5 + 0.45 * aft**2
    keel = KEEL + 0.10 * fore**6 + 0.07 * aft**4
    y = half_breadth(x) * t**fullness * (1 - 0.16 * np.clip(t - 0.45, 0, 1) ** 1.5)
    z = keel + np.clip(t / SHEER, 0, 1) * (sheer(x) - keel)
    z = z + np.clip((t - SHEER) / (1 - SHEER), 0, 1) * (deck(x) + 0.05 - sheer(x))
    # straight stem and sternpost: the end sections stay plane
    rake = (0.10 * fore**5 - 0.05 * aft**5) * (z - keel) / (z[:, -1:] - keel)
    return np.stack([x + rake, -y, z], axis=-1)


def hull() -> Solid:
    """The keel, side, bulwark, deck and back as one closed surface; u runs around it from the keel."""
    x = stations()
    outside = side(x, np.linspace(0.0, 1.0, STRAKES))
    rail = outside[:, -1]
    level = deck(x)
    level[[0, -1]] = rail[[0, -1], 2]  # bulkheads: the ends are closed up to the rail
    foot = [[np.interp(z, line[:, 2], axis) for axis in line.T] for z, line in zip(level, outside, strict=True)]
    inside = inboard(np.stack([rail, np.array(foot)], axis=1))
    middle = inside[:, -1:] * np.array([1.0, 0.0, 1.0])
    half = np.concatenate([outside, inside, middle], axis=1)
    port = half[:, 1:-1] * np.array([1.0, -1.0, 1.0])
    return loft(np.concatenate([half[:, :1], port, half[:, :0:-1]], axis=1))


def inboard(points: np.ndarray, thickness: float = 0.014) -> np.ndarray:
    """Move points through the planking of the starboard side, at most to the middle of the ship."""
    y = np.minimum(points[..., 1] + thickness, 0.2 * points[..., 1])
    return np.stack([points[..., 0], y, points[..., 2]], axis=-1)


def planks() -> np.ndarray:
    """Colour the columns around the hull: tarred bottom, brown strakes, pale stripe of the guns, scrubbed deck."""
    rows, columns = 256, 560
    t = (1 - np.abs(np.linspace(-1, 1, columns))) * (STRAKES + 2) / (STRAKES - 1)
    stain, wear = surfaces.mottle(8, rows, columns, 0.9), surfaces.mottle(9, rows, columns, 0.8)
    colour = surfaces.mixed((0.12, 0.05, 0.02), (0.23, 0.11, 0.045), stain)
    for low, high, paint in ((0.0, 0.36, TAR), (0.62, 0.74, OCHRE), (1.0, 2.0, DECK)):
        band = (low <= t) & (t < high)
        colour[:, band] = np.array(paint) * (0.85 + 0.3 * wear[:, band, None])
    colour[:, (t * (STRAKES - 1) % 1.0 < 0.14) & (t < 1.0)] *= 0.45
    # the flat ends, stem and transom, take the outermost rows
    colour[[0, -1]] = (0.17, 0.08, 0.032)
    return colour


def on_side(x: float, t: float, starboard: bool) -> np.ndarray:
    point = side(np.array([x]), np.array([t]))[0, 0]
    return np.asarray(point * np.array([1, 1 if starboard else -1, 1]))


def fittings() -> Solid:
    parts = [box(0.075, 0.012, 0.25).moved(x=STERN - 0.045, z=WATER + 0.02)]
    parts += [box(0.09, 0.12, 0.03).moved(x=x, z=float(deck(np.array([x]))[0]) + 0.012) for x in (0.16, -0.16)]
    for starboard in (True, False):
        parts += [box(0.034, 0.02, 0.028).moved(*on_side(x, 0.68, starboard)) for x in np.linspace(-0.5, 0.38, 10)]
        parts += [box(0.17, 0.05, 0.008).moved(*channel(x, starboard)) for x in MASTS_AT]
        parts += [*rails(starboard), *anchor(starboard)]
    return merged(parts)


def rails(starboard: bool) -> list[Solid]:
    """Make the rails on top of each stretch of the bulwark, and the wale below the guns."""
    stretches = [(low + 0.003, high - 0.003, 1.0) for low, high in itertools.pairwise(sorted((STERN, *STEPS, BOW)))]
    return [
        tube(np.array([on_side(x, t, starboard) for x in np.linspace(low, high, 30)]), 0.008, sides=6)
        for low, high, t in [*stretches, (STERN, BOW, 0.56)]
    ]


def anchor(starboard: bool) -> list[Solid]:
    ring = on_side(0.5, 0.8, starboard) * np.array([1, 1.12, 1])
    along = np.linspace(-1, 1, 9)
    arms = np.stack([0.045 * along, np.zeros(9), 0.03 * along**2 - 0.12], axis=-1)
    return [tube(ring + line, 0.006) for line in (np.array([[0, 0, 0.02], [0, 0, -0.11]]), arms)]


def channel(x: float, starboard: bool) -> np.ndarray:
    """A channel, where the shrouds of a mast meet the side; they pull aft."""
    return np.asarray(on_side(x - 0.05, SHEER, starboard) * np.array([1, 1.1, 1]))


def gilding() -> Solid:
    """Stern windows between two galleries, lanterns above, a figurehead."""
    low, windows, high, rail = (on_side(STERN, t, starboard=True) for t in (0.60, 0.72, 0.84, 1.0))
    parts = [box(0.012, 0.026, 0.04).moved(x=windows[0], y=y, z=windows[2]) for y in np.linspace(-0.07, 0.07, 4)]
    parts += [box(0.022, -2 * edge[1], 0.009).moved(x=edge[0], z=edge[2]) for edge in (low, high)]
    parts += [ball(0.015, 16).scaled(1, 1, 1.5).moved(x=rail[0], y=y, z=rail[2] + 0.02) for y in (-0.075, 0, 0.075)]
    stem = on_side(BOW, 0.8, starboard=True)
    parts.append(ball(0.02, 16).scaled(2.2, 0.8, 0.9).turned(-35, (0, 1, 0)).moved(x=stem[0] + 0.006, z=stem[2]))
    return merged(parts)
