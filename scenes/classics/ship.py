"""A three-masted sailing ship in a basin of clear water over sand."""

from dataclasses import dataclass

import numpy as np

from scenes import surfaces
from scenes.lighting import studio
from scenes.scene import Description, Scene
from scenes.solids import Solid, ball, box, cylinder, grid_faces, lathe, loft, merged, mesh, smooth, tube

WATER = -0.40
KEEL = WATER - 0.11
BASIN_RADIUS, BASIN_BOTTOM = 1.08, -0.68
STERN, BOW = -0.64, 0.60
BEAM = 0.185
"""Half the greatest breadth."""


@dataclass(frozen=True)
class Mast:
    """A mast with its square yards."""

    x: float
    foot: float
    top: float
    """The platform where the shrouds end."""
    head: float
    yards: tuple[tuple[float, float], ...]
    """(height, half-length) of each yard, lowest first."""
    set_sails: tuple[int, ...]
    """Yards, by index, whose sail is set; it reaches down to the yard below. The others are furled."""


FORE = Mast(0.33, -0.3, 0.12, 0.80, ((-0.03, 0.31), (0.31, 0.25), (0.60, 0.18)), (1, 2))
MAIN = Mast(-0.04, -0.3, 0.18, 0.98, ((0.00, 0.36), (0.39, 0.29), (0.73, 0.20)), (1, 2))
MIZZEN = Mast(-0.41, -0.2, 0.12, 0.66, ((0.12, 0.22), (0.43, 0.17)), (1,))
MASTS = (FORE, MAIN, MIZZEN)
BOWSPRIT = np.array([[0.50, 0.0, -0.20], [0.97, 0.0, 0.02]])


def build() -> Description:
    set_sails, furled = sails()
    wood = surfaces.texture(surfaces.mixed((0.17, 0.075, 0.03), (0.30, 0.15, 0.065), surfaces.mottle(5)))
    return {
        "type": "scene",
        "light": studio(brightness=1.3),
        "basin": mesh(basin(), surfaces.plastic((0.035, 0.05, 0.06), roughness=0.15)),
        "seabed": mesh(seabed(), surfaces.matte(surfaces.texture(sand()))),
        "water": mesh(water(), surfaces.tinted(surfaces.water(), (0.72, 0.90, 0.93))),
        "hull": mesh(hull(), surfaces.plastic(surfaces.texture(planks()), roughness=0.3)),
        "spars": mesh(spars(), surfaces.plastic(surfaces.srgb("#8a5a2c"), roughness=0.3)),
        "fittings": mesh(fittings(), surfaces.plastic(surfaces.srgb("#3a2416"), roughness=0.3)),
        "gilding": mesh(gilding(), surfaces.gold(0.2)),
        "rigging": mesh(rigging(), surfaces.matte(surfaces.srgb("#3b2c1d"))),
        "sails": mesh(set_sails, surfaces.thin(surfaces.texture(canvas()), 0.3, roughness=0.9)),
        "furled": mesh(furled, surfaces.matte((0.62, 0.54, 0.40))),
        "flag": mesh(flag(), surfaces.thin(surfaces.srgb("#b3161b"), 0.3, roughness=0.8)),
    }


# ---- water -----------------------------------------------------------------------------------------------


def basin() -> Solid:
    """A round bowl; the water and the sand fill it."""
    r, low = BASIN_RADIUS, BASIN_BOTTOM
    outside = [(0, low), (r - 0.08, low), (r - 0.05, low + 0.01), (r - 0.01, low + 0.05), (r, low + 0.1)]
    rim = [(r + 0.005, WATER + 0.01), (r + 0.003, WATER + 0.02), (r - 0.005, WATER + 0.026), (r - 0.028, WATER + 0.026)]
    inside = [(r - 0.036, WATER + 0.02), (r - 0.038, WATER + 0.01), (r - 0.04, low + 0.03), (0, low + 0.03)]
    return smooth(lathe([*outside, *rim, *inside], segments=128))


def disc(radius: float, rings: int, segments: int) -> tuple[np.ndarray, np.ndarray]:
    """x and y [segments + 1, rings] over a disc, from the centre out; for `grid_faces`."""
    angle = np.linspace(0, -2 * np.pi, segments + 1)[:, None]
    r = radius * np.linspace(0, 1, rings)
    return np.cos(angle) * r, np.sin(angle) * r


def waves(x: np.ndarray, y: np.ndarray, seed: int, longest: float, height: float, count: int = 14) -> np.ndarray:
    """Sum of sine waves, mostly along one wind."""
    random = np.random.default_rng(seed)
    z = np.zeros_like(x)
    for length in np.geomspace(longest, longest / 4, count):
        heading = random.normal(0.6, 0.7)
        phase = 2 * np.pi * (random.uniform() + (np.cos(heading) * x + np.sin(heading) * y) / length)
        z += height * length / longest * np.sin(phase)
    return z


def water() -> Solid:
    """Closed body: its sides lie inside the wall of the basin, its bottom below the sand."""
    radius = BASIN_RADIUS - 0.02
    x, y = disc(radius, rings=110, segments=240)
    ripple = waves(x, y, seed=7, longest=0.34, height=0.0045)
    skirt_x, skirt_y = x[:, -1:] * np.array([1.0, 0.0]), y[:, -1:] * np.array([1.0, 0.0])
    bottom = np.full_like(skirt_x, BASIN_BOTTOM + 0.015)
    z = np.concatenate([WATER + ripple, bottom], axis=1)
    vertices = np.stack([np.hstack([x, skirt_x]), np.hstack([y, skirt_y]), z], axis=-1)
    return smooth(Solid(vertices.reshape(-1, 3), grid_faces(*vertices.shape[:2])))


def seabed() -> Solid:
    """Dunes that rise towards the wall; open below, where nothing looks."""
    x, y = disc(BASIN_RADIUS - 0.03, rings=50, segments=120)
    r = np.hypot(x, y) / BASIN_RADIUS
    z = BASIN_BOTTOM + 0.06 + 0.09 * r**4 + waves(x, y, seed=3, longest=0.6, height=0.008)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    uv = vertices[:, :2] / (2 * BASIN_RADIUS) + 0.5
    return smooth(Solid(vertices, grid_faces(*x.shape), uv))


def sand() -> np.ndarray:
    """Pale sand, bluish in the hollows, with dark weed."""
    grain = surfaces.mixed((0.20, 0.33, 0.32), (0.62, 0.58, 0.42), surfaces.mottle(21, 256, 256, 1.3))
    weed = 1 / (1 + np.exp(-(surfaces.mottle(22, 256, 256, 1.9) - 0.68) / 0.02))
    return grain + weed[..., None] * (np.array((0.03, 0.085, 0.055)) - grain)


# ---- hull ------------------------------------------------------------------------------------------------


def deck(x: np.ndarray) -> np.ndarray:
    """Height of the deck: waist, forecastle ahead, quarterdeck and poop aft."""
    height = WATER + 0.085 + 0.10 * (x / 0.62) ** 2 * np.where(x < 0, 1.0, 0.55)
    return height + 0.055 * (x > 0.36) + 0.06 * (x < -0.22) + 0.055 * (x < -0.45)


def gunwale(x: np.ndarray) -> np.ndarray:
    return deck(x) + 0.05


def half_breadth(x: np.ndarray) -> np.ndarray:
    """Of the deck: full aft with a flat stern, pointed at the bow."""
    ahead = np.clip((x - 0.08) / (BOW - 0.08), 0, 1)
    behind = np.clip((0.0 - x) / (0.0 - STERN), 0, 1)
    return BEAM * np.sqrt(np.clip(1 - ahead**2.4, 0, 1)) * (1 - 0.36 * behind**2) + 0.004


def stations() -> np.ndarray:
    """x of the cross-sections: two close together at each step of the deck."""
    steps = [step + side for step in (0.36, -0.22, -0.45) for side in (-0.002, 0.002)]
    return np.unique(np.concatenate([np.linspace(STERN, 0.4, 44), np.linspace(0.42, BOW, 24), steps]))


def side(x: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Point of the starboard side (y < 0) at station x [N], t from the keel (0) to the gunwale (1) [M]."""
    x, t = x[:, None], t[None]
    fore = np.clip((x - 0.05) / (BOW - 0.05), 0, 1)
    aft = np.clip((-0.2 - x) / (-0.2 - STERN), 0, 1)
    fullness = 0.30 + 0.55 * fore**1.5 + 0.45 * aft**2
    keel = KEEL + 0.10 * fore**6 + 0.07 * aft**4
    y = half_breadth(x) * t**fullness * (1 - 0.16 * np.clip(t - 0.45, 0, 1) ** 1.5)
    z = keel + t * (gunwale(x) - keel)
    return np.stack([x + 0.10 * fore**5 * t**1.5 - 0.05 * aft**5 * t, -y, z], axis=-1)


def hull() -> Solid:
    """Keel, side, bulwark, deck and back: one closed surface; u runs around it from the keel."""
    x = stations()
    outside = side(x, np.linspace(0.0, 1.0, 25))
    rail, foot = outside[:, -1:].copy(), outside[:, -1:].copy()
    thickness = np.minimum(0.014, 0.8 * np.abs(rail[..., 1]))
    rail[..., 1] += thickness
    foot[..., 1] += thickness
    foot[..., 2] = deck(x)[:, None]
    middle = foot * np.array([1.0, 0.0, 1.0]) + np.array([0.0, 0.0, 0.008])
    half = np.concatenate([outside, rail, foot, middle], axis=1)
    other = half[:, -2:0:-1] * np.array([1.0, -1.0, 1.0])
    return loft(np.concatenate([half, other], axis=1)[:, ::-1])


def planks() -> np.ndarray:
    """Around the hull along the columns: tarred bottom, brown strakes, pale stripe of the guns, scrubbed deck."""
    rows, columns = 256, 560
    half = np.abs(np.linspace(-1, 1, columns))[None] * np.ones((rows, 1))
    strake = 1 - half
    height = strake * 28 / 25 * 1.0
    colour = surfaces.mixed((0.12, 0.05, 0.02), (0.23, 0.11, 0.045), surfaces.mottle(8, rows, columns, 0.9))
    for low, high, paint in ((0.0, 0.36, (0.035, 0.03, 0.028)), (0.62, 0.74, (0.62, 0.42, 0.13)), (1.0, 2.0, (0.42, 0.29, 0.16))):
        band = ((height >= low) & (height < high))[..., None]
        colour = np.where(band, np.array(paint) * (0.85 + 0.3 * surfaces.mottle(9, rows, columns, 0.8)[..., None]), colour)
    seam = (height * 25 % 1.0 < 0.14)[..., None]
    return np.where(seam, 0.45 * colour, colour)


def on_side(x: float, t: float, starboard: bool) -> np.ndarray:
    point = side(np.array([x]), np.array([t]))[0, 0]
    return point * np.array([1, 1 if starboard else -1, 1])


def fittings() -> Solid:
    """Gun ports, rails, hatches, channels of the shrouds, rudder, tops, boat, anchors."""
    parts = [box(0.075, 0.012, 0.25).moved(x=STERN - 0.045, z=WATER + 0.02)]
    for starboard in (True, False):
        parts += [
            box(0.034, 0.02, 0.028).moved(*on_side(x, 0.68, starboard)) for x in np.linspace(-0.5, 0.38, 10)
        ]
        for low, high in ((STERN, -0.451), (-0.449, -0.221), (-0.219, 0.359), (0.361, BOW)):
            line = np.array([on_side(x, 1.0, starboard) for x in np.linspace(low, high, 12)])
            parts.append(tube(line, 0.009, sides=6))
        wale = np.array([on_side(x, 0.56, starboard) for x in np.linspace(STERN, BOW, 40)])
        parts.append(tube(wale, 0.007, sides=6))
        for mast in MASTS:
            parts.append(box(0.17, 0.05, 0.008).moved(*channel(mast, 0.0, starboard)))
        anchor_ring = on_side(0.5, 0.8, starboard) * np.array([1, 1.12, 1])
        parts.append(tube(anchor_ring + np.array([[0, 0, 0.02], [0, 0, -0.11]]), 0.006))
        bow_curve = np.linspace(-1, 1, 9)
        arc = np.stack([0.045 * bow_curve, 0 * bow_curve, 0.03 * bow_curve**2 - 0.12], axis=-1)
        parts.append(tube(anchor_ring + arc, 0.006))
    for x in (0.16, -0.16):
        parts.append(box(0.09, 0.12, 0.03).moved(x=x, z=float(deck(np.array(x))) + 0.012))
    for mast in MASTS:
        platform = [(0, 0), (0.045, 0.0), (0.062, 0.012), (0.062, 0.02), (0, 0.02)]
        parts.append(lathe(platform, segments=24).moved(x=mast.x, z=mast.top))
    return merged(Solid(part.vertices, part.faces) for part in parts)


def gilding() -> Solid:
    """Stern windows and gallery, figurehead, lanterns."""
    stern_x = STERN - 0.052
    windows = [box(0.012, 0.03, 0.035).moved(x=stern_x + 0.002, y=y, z=WATER + 0.175) for y in np.linspace(-0.08, 0.08, 4)]
    gallery = [box(0.02, 0.225, 0.01).moved(x=stern_x, z=WATER + z) for z in (0.145, 0.205)]
    lanterns = [ball(0.018, 16).scaled(1, 1, 1.4).moved(x=stern_x, y=y, z=WATER + 0.36) for y in (-0.07, 0.0, 0.07)]
    figure = ball(0.03, 16).scaled(1.6, 0.7, 1.0).turned(-30, (0, 1, 0)).moved(x=0.73, z=WATER + 0.2)
    return merged(Solid(part.vertices, part.faces) for part in [*windows, *gallery, *lanterns, figure])


# ---- masts and sails -------------------------------------------------------------------------------------


def spars() -> Solid:
    """Masts, bowsprit, yards, the gaff and boom of the spanker."""
    parts = []
    for mast in MASTS:
        line = np.array([[mast.x, 0, z] for z in (mast.foot - 0.1, mast.top, mast.top + 0.02, mast.head)])
        parts.append(tube(line, np.array([0.021, 0.017, 0.012, 0.005]), sides=12))
        parts += [spar(ends_of_yard(mast, yard), 0.011 - 0.0025 * yard) for yard in range(len(mast.yards))]
    parts += [spar(gaff(), 0.007), spar(boom(), 0.008)]
    parts.append(tube(BOWSPRIT, np.array([0.019, 0.007]), sides=12))
    return merged(smooth(part) for part in parts)


def spar(ends: np.ndarray, radius: float) -> Solid:
    """Thickest in the middle."""
    t = np.linspace(0, 1, 9)
    return tube(ends[0] + t[:, None] * (ends[1] - ends[0]), radius * (1 - 0.5 * (2 * t - 1) ** 2), sides=8)


def ends_of_yard(mast: Mast, yard: int, ahead: float = 0.022) -> np.ndarray:
    """Port and starboard end, braced round a little to the wind."""
    z, half = mast.yards[yard]
    brace = np.radians(14)
    reach = half * np.array([np.sin(brace), np.cos(brace), 0])
    return np.array([mast.x + ahead, 0, z]) + np.array([[1], [-1]]) * reach


def gaff() -> np.ndarray:
    return np.array([[MIZZEN.x - 0.02, 0, 0.10], [MIZZEN.x - 0.32, 0, 0.24]])


def boom() -> np.ndarray:
    return np.array([[MIZZEN.x - 0.02, 0, -0.13], [MIZZEN.x - 0.38, 0, -0.10]])


def sail(corners: np.ndarray, belly: np.ndarray, across: int = 17, down: int = 15) -> Solid:
    """Cloth between four corners (head left, head right, foot left, foot right), blown out along `belly`."""
    u, v = np.meshgrid(np.linspace(0, 1, across), np.linspace(0, 1, down), indexing="ij")
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=-1)
    bulge = np.sin(np.pi * u) ** 0.7 * np.sin(np.pi * np.clip(v * 0.93, 0, 1)) ** 0.7
    # the foot is cut as an arch
    rise = 0.10 * (corners[0, 2] - corners[2, 2]) * np.sin(np.pi * u) * v**4
    points = weights @ corners + bulge[..., None] * belly + rise[..., None] * np.array([0, 0, 1.0])
    return smooth(Solid(points.reshape(-1, 3), grid_faces(across, down), np.stack([u, v], -1).reshape(-1, 2)))


def sails() -> tuple[Solid, Solid]:
    """Those that are set, and those furled on their yards."""
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
    tack, clew, throat, peak = boom()[0], boom()[1], gaff()[0], gaff()[1]
    aft = np.array([-0.015, 0, 0])
    spanker = np.array([throat + aft, peak, tack + aft, clew - 0.2 * aft])
    spread.append(sail(spanker, np.array([0.0, -0.05, 0])))
    for high, low, share in ((0.62, 0.95, 0.80), (0.36, 0.60, 0.75)):
        head = np.array([FORE.x + 0.02, 0, high])
        nose = BOWSPRIT[0] + low * (BOWSPRIT[1] - BOWSPRIT[0])
        top = head + 0.22 * (nose - head)
        bottom = head + 0.94 * (nose - head)
        clew_ = np.array([FORE.x + 0.12, -0.10, bottom[2] + 0.05])
        spread.append(sail(np.array([top, top, bottom, bottom + share * (clew_ - bottom)]), np.array([0.0, -0.04, 0])))
    return merged(spread), merged(furled)


def narrowed(ends: np.ndarray, share: float) -> np.ndarray:
    middle = ends.mean(axis=0)
    return middle + share * (ends - middle)


def bundle(ends: np.ndarray, seed: int) -> Solid:
    """A sail rolled up below its yard, pinched by its gaskets."""
    t = np.linspace(0, 1, 61)
    pinch = np.abs(np.sin(np.pi * 9 * t)) ** 0.5
    radius = (0.011 + 0.013 * pinch) * (1 - 0.45 * np.abs(2 * t - 1) ** 2)
    wobble = 0.002 * np.random.default_rng(seed).normal(size=(61, 3))
    line = ends[0] + t[:, None] * (ends[1] - ends[0]) + wobble - np.array([0, 0, 0.016])
    return smooth(tube(line, radius, sides=10))


def canvas() -> np.ndarray:
    """Cream cloth with seams between its strips and reef bands across."""
    rows, columns = 128, 192
    cloth = surfaces.mixed((0.74, 0.66, 0.50), (0.86, 0.80, 0.66), surfaces.mottle(31, rows, columns, 1.1))
    seam = (np.arange(columns)[None] % 24 < 1) | (np.abs(np.arange(rows)[:, None] - 30) < 1)
    return np.where(seam[..., None], 0.7 * cloth, cloth)


def flag() -> Solid:
    u, v = np.meshgrid(np.linspace(0, 1, 17), np.linspace(0, 1, 5), indexing="ij")
    x = MAIN.x - 0.005 - 0.17 * u
    y = 0.022 * u * np.sin(7 * u) - 0.06 * u
    return smooth(Solid(np.stack([x, y, MAIN.head - 0.01 - 0.08 * v - 0.02 * u], -1).reshape(-1, 3), grid_faces(17, 5)))


# ---- rigging ---------------------------------------------------------------------------------------------


def channel(mast: Mast, aft: float, starboard: bool) -> np.ndarray:
    """Where a shroud meets the side."""
    return on_side(mast.x - 0.05 - aft, 0.93, starboard) * np.array([1, 1.08, 1])


def rope(start: np.ndarray, end: np.ndarray, radius: float = 0.0032) -> Solid:
    return tube(np.array([start, end]), radius, sides=5)


def rigging() -> Solid:
    lines = [line for mast in MASTS for line in [*standing(mast), *braces(mast)]]
    at = lambda mast, z: np.array([mast.x, 0.0, z])
    nose = [BOWSPRIT[0] + share * (BOWSPRIT[1] - BOWSPRIT[0]) for share in (0.6, 0.8, 0.98)]
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
        (gaff()[1], at(MIZZEN, 0.4)),
        (boom()[1], at(MIZZEN, MIZZEN.top)),
    ]
    return merged([*lines, *(rope(*stay) for stay in stays)])


def standing(mast: Mast) -> list[Solid]:
    """Shrouds with their ratlines up to the top, then up to the topmast, and backstays."""
    lines = []
    for starboard in (True, False):
        feet = np.array([channel(mast, aft, starboard) for aft in np.linspace(-0.06, 0.07, 5)])
        lean = np.array([0.012, 0.05 if not starboard else -0.05, 0.0])
        tops = np.array([mast.x, 0, mast.top]) + np.linspace([0.02, 0, 0], [-0.02, 0, 0], 5) + 0.3 * lean
        lines += ladder(feet, tops, rungs=13)
        upper_feet = np.array([mast.x, 0, mast.top + 0.015]) + lean + np.linspace([0.01, 0, 0], [-0.035, 0, 0], 3)
        upper_tops = np.repeat([[mast.x, 0, mast.top + 0.62 * (mast.head - mast.top)]], 3, axis=0)
        lines += ladder(upper_feet, upper_tops, rungs=9)
        lines.append(rope(np.array([mast.x, 0, mast.head - 0.04]), channel(mast, 0.10, starboard), 0.0026))
    return lines


def ladder(feet: np.ndarray, tops: np.ndarray, rungs: int) -> list[Solid]:
    """Shrouds from feet to tops, tied together by rungs across."""
    shrouds = [rope(foot, top) for foot, top in zip(feet, tops, strict=True)]
    shares = np.linspace(0, 1, rungs + 2)[1:-1, None]
    left, right = feet[0] + shares * (tops[0] - feet[0]), feet[-1] + shares * (tops[-1] - feet[-1])
    return shrouds + [rope(a, b, 0.0022) for a, b in zip(left, right, strict=True)]


def braces(mast: Mast) -> list[Solid]:
    """From the ends of each yard up to the mast (lifts) and aft to the rail or the next mast (braces)."""
    lines = []
    for yard, (z, _) in enumerate(mast.yards):
        for end, sign in zip(ends_of_yard(mast, yard), (1, -1), strict=True):
            lines.append(rope(end, np.array([mast.x, 0, min(z + 0.16, mast.head)]), 0.002))
            aft = max(mast.x - 0.33, STERN + 0.02)
            lines.append(rope(end, on_side(aft, 1.0, starboard=sign < 0), 0.002))
    return lines


SCENE = Scene(
    name="ship",
    title="A sailing ship in water: rigging thinner than a pixel, a hull seen through waves",
    build=build,
    max_depth=10,
)
