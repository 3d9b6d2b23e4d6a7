"""The interface of a reader of posed images in any format, and the region that its cameras look at: a box that all
cameras see, and the hull of the silhouettes, the cells of the box that may be occupied.

`scenes.view_sets.formats.foreign` chooses the reader of a path.
"""

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter, minimum_filter

from scenes.files.errors import InputError
from scenes.view_sets.formats.transforms import Frames
from scenes.view_sets.image_stack import ImageStack
from scenes.view_sets.viewpoints import SPLITS

LEAST, MOST = 1e-12, 1e12
"""The range of lengths whose squares fit single precision."""

THINNEST = 1e-4
"""The minimum ratio of a box's shortest side to its longest: rays would have no samples in a thinner one."""


@dataclass(frozen=True)
class Region:
    """The region of all visible geometry; None: not given. Raises `InputError` for an invalid box or distances."""

    bounds: tuple[float, ...] | None = None
    """The lower corner, then the upper corner: six numbers."""
    near: float | None = None
    far: float | None = None

    def __post_init__(self) -> None:
        if self.bounds is not None:
            box = self.bounds
            if len(box) != 6 or not all(abs(x) <= MOST for x in box) or any(box[i] >= box[i + 3] for i in range(3)):
                corners = f"two corners, x y z each, up to {MOST:g}, the lower one first"
                raise InputError(f"bounds {list(box)}: give {corners}")
            sides = [box[i + 3] - box[i] for i in range(3)]
            if min(sides) < THINNEST * max(sides):
                raise InputError(f"bounds {list(box)}: a box of sides {sides} holds nothing; make it thicker")
        given = [distance for distance in (self.near, self.far) if distance is not None]
        if not all(LEAST <= distance <= MOST for distance in given) or given != sorted(set(given)):
            between = f"distances between {LEAST:g} and {MOST:g}, near the smaller one"
            raise InputError(f"near {self.near} and far {self.far}: give {between}")

    @property
    def box(self) -> np.ndarray | None:
        """The bounds as float64 [2, 3]."""
        return None if self.bounds is None else np.array(self.bounds, dtype=np.float64).reshape(2, 3)

    def over(self, other: "Region") -> "Region":
        """Return this region, with missing values from `other`."""
        return Region(
            other.bounds if self.bounds is None else self.bounds,
            other.near if self.near is None else self.near,
            other.far if self.far is None else self.far,
        )


def region_in(where: object, bounds: tuple[float, ...] | None, near: float | None, far: float | None) -> Region:
    """Return the region that a file gives; raises `InputError`, which names `where`, if it is invalid."""
    try:
        return Region(bounds, near, far)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


@dataclass(frozen=True)
class Source:
    """A source of posed images: poses are read, pixels not yet."""

    name: str
    frames: Callable[[str], Frames | None]
    """Return all views of a split, or None for a missing optional split; raises `InputError` for invalid data."""
    pixels: Callable[[Path, int | None], np.ndarray]
    """Return straight RGBA float32 [h, w, 4] of a frame's file, at a width (None: as `size`); raises `InputError`."""
    size: Callable[[Path], tuple[int, int]]
    """Return height and width of one of the frames' files before it is resized; raises `InputError`."""
    region: Region
    """The region as the format gives it; missing values are derived from the cameras (`completed`)."""
    notes: tuple[str, ...] = ()
    """The assumptions made, one sentence each, for the user."""
    bounds_assumed: bool = False
    """Whether the region's bounds are a convention of the format's users, not given in the file."""
    unbounded: str = ""
    """Why no bounds can be derived, if so: the user must give them."""


ASK = "say where the scene lies with --bounds X0 Y0 Z0 X1 Y1 Z1"
LEAST_IN_FRONT = 0.9
"""The share of the cameras that must look towards the common point."""
LEAST_SPREAD = 1e-4
"""The minimum eigenvalue of the mean projector across the views: cameras of one direction have no common point."""
LEAST_NEAR = 0.02
"""The minimum of near / far, for a camera in the box or close to it."""
FEWEST = 10
"""The smallest number of views of which a tenth can be held out."""


def nine_to_one(count: int, file: Path, remedy: str) -> tuple[list[int], list[int]]:
    """Return the indices of nine tenths of the views, evenly spread, for training, and of the others."""
    train = math.ceil(count * 0.9)
    if count < FEWEST:
        raise InputError(f"{file}: {count} views without splits are too few to hold any out for testing; {remedy}")
    chosen = np.linspace(0, count - 1, train, dtype=int).tolist()
    return chosen, sorted(set(range(count)) - set(chosen))


def completed(
    given: Region, source: Source, fov_x_radians: float, size: tuple[int, int], where: Path
) -> tuple[np.ndarray, float, float]:
    """Return box [2, 3], near and far: as `given`, else derived from the cameras of all splits, so that the result does
    not depend on the splits that are read. `size` is height, width. Raises `InputError` as `looked_at`.
    """
    box, near, far = given.box, given.near, given.far
    if box is None and source.unbounded:
        raise InputError(f"{where}: {source.unbounded}; cut the object out as alpha, or {ASK}")
    if box is None or near is None or far is None:
        poses = np.concatenate([views.camera_to_world for split in SPLITS if (views := source.frames(split))])
        box = looked_at(poses, fov_x_radians, size[0] / size[1], str(where)) if box is None else box
        # from the nearest camera to the box, and from the farthest to its farthest corner
        o = poses[:, :3, 3]
        outside = np.maximum(np.maximum(box[0] - o, o - box[1]), 0.0)
        corner = np.maximum(np.abs(o - box[0]), np.abs(o - box[1]))
        farthest = float(np.linalg.norm(corner, axis=1).max())
        nearest = max(float(np.linalg.norm(outside, axis=1).min()), LEAST_NEAR * farthest)
        near = min(nearest, 0.5 * (far or math.inf)) if near is None else near
        far = max(farthest, 2 * near) if far is None else far
    return box, near, far


def looked_at(camera_to_world: np.ndarray, fov_x_radians: float, aspect: float, where: str) -> np.ndarray:
    """Return a box [2, 3] that every pixel's ray of every camera [n, 4, 4] meets, about the point nearest to all axes.

    `aspect` is height over width. Cameras on the sphere of the NeRF synthetic set get ±1.8 (±1.5 cuts off the corners).
    Raises `InputError`, which names `where`, for cameras without a common point: side by side, or looking outwards.
    """
    o, d = camera_to_world[:, :3, 3], -camera_to_world[:, :3, 2]
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    total = across.sum(axis=0)
    if np.linalg.eigvalsh(total)[0] < LEAST_SPREAD * len(o):
        raise InputError(f"{where}: the cameras all look in one direction, so what they look at is not known; {ASK}")
    centre = np.linalg.solve(total, np.einsum("nij,nj->i", across, o))
    ahead = np.einsum("ni,ni->n", centre - o, d) > 0
    if ahead.mean() < LEAST_IN_FRONT:
        raise InputError(
            f"{where}: {int((~ahead).sum())} of {len(o)} cameras look away from the point that all axes pass; {ASK}"
        )
    half = np.array([math.tan(0.5 * fov_x_radians), aspect * math.tan(0.5 * fov_x_radians)])
    corners = np.array([[x, y, -1.0] for x in (-half[0], half[0]) for y in (-half[1], half[1])])
    rays = np.einsum("nij,cj->nci", camera_to_world[ahead, :3, :3], corners)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    away = (centre - o[ahead])[:, None]
    along = np.maximum(np.einsum("nci,nci->nc", np.broadcast_to(away, rays.shape), rays), 0.0)
    radius = float(np.linalg.norm(away - along[..., None] * rays, axis=-1).max())
    if not radius > 1e-9:
        raise InputError(f"{where}: all cameras stand on one point, so nothing has a distance; {ASK}")
    return np.array([centre - radius, centre + radius])


CELLS = 96
"""The number of cells of a hull along each axis: about one per pixel of a picture 100 pixels wide."""
MISSES = 0.02
"""The share of the views that may see background through a kept cell: one bad mask of 50 has no effect."""
LEAST_ALPHA = 0.5 / 255
"""The minimum alpha of a covered pixel: half a step of an 8-bit image."""
MARGIN = 1.0
"""The pixels by which a silhouette is widened, in addition to half of a cell: an edge can lie between samples."""


def covered(alpha: np.ndarray, pixels: int) -> np.ndarray:
    """Return where an image [h, w] is covered, or within `pixels` of that along either axis, bool [h, w]."""
    return np.asarray(maximum_filter(alpha >= LEAST_ALPHA, size=2 * pixels + 1, mode="constant", cval=False))


EDGE = 0.02
"""The distance from covered pixels, in widths of a picture, within which a pixel counts as covered: outlines are learnt
from the background next to them.
"""


def covered_pixels(rgba: ImageStack) -> np.ndarray:
    """Return the pixels int64 [n] that are covered or near a covered pixel, numbered through all images by rows."""
    _, height, width, _ = rgba.shape
    margin = max(1, round(EDGE * width))
    places = [np.flatnonzero(covered(image[..., 3], margin)) + k * height * width for k, image in enumerate(rgba)]
    return np.concatenate([np.zeros(0, dtype=np.int64), *places])


def contrast(colours: np.ndarray) -> np.ndarray:
    """Return the largest difference of a channel within 3 × 3 pixels around each pixel of [h, w, channels], [h, w]."""
    around = (3, 3, 1)
    return np.asarray((maximum_filter(colours, around) - minimum_filter(colours, around)).max(axis=-1))


def hull(
    bounds: np.ndarray, alphas: Iterable[np.ndarray], camera_to_world: np.ndarray, focal: float, cells: int = CELLS
) -> np.ndarray:
    """Return the visual hull bool [cells, cells, cells] in the box `bounds` [2, 3].

    A cell is empty if views see the background through it. `alphas` are the images [h, w] of the poses [n, 4, 4] in
    OpenGL axes; `focal` is in pixels. A view does not judge cells that it does not see.
    """
    side = (bounds[1] - bounds[0]) / cells
    reach = 0.5 * float(np.linalg.norm(side))
    allowed = int(MISSES * len(camera_to_world))
    blocks = _blocks(bounds, cells)
    for alpha, pose in zip(alphas, camera_to_world, strict=True):
        rotation, origin = pose[:3, :3].T.astype(np.float32), pose[:3, 3:].astype(np.float32)
        silhouettes: dict[int, np.ndarray] = {}
        for block in blocks:
            x, y, z = rotation @ (block.centres - origin)
            depth = -z
            ahead = depth > 2.0 * reach
            if not ahead.any():
                continue
            # the nearest cell is the largest in the picture
            pixels = int(np.ceil(reach * focal / (depth[ahead].min() - reach) + MARGIN))
            if pixels not in silhouettes:
                silhouettes[pixels] = ~np.pad(covered(alpha, pixels), 1, constant_values=True)
            scale = focal / np.where(ahead, depth, np.inf)
            height, width = alpha.shape
            column = np.clip(x * scale + (0.5 * width + 1), 0, width + 1).astype(np.int32)
            row = np.clip((0.5 * height + 1) - y * scale, 0, height + 1).astype(np.int32)
            block.misses += silhouettes[pixels].ravel()[row * (width + 2) + column] & ahead
            block.drop(block.misses > allowed)
    occupied = np.zeros(cells**3, dtype=bool)
    for block in blocks:
        occupied[block.index] = True
    return occupied.reshape((cells,) * 3)


@dataclass
class _Block:
    """Neighbouring cells of a hull that may still be occupied; a view's work on a block fits the processor's cache."""

    index: np.ndarray
    """The indices int [n] in the hull."""
    centres: np.ndarray
    """The centres float32 [3, n]."""
    misses: np.ndarray
    """The number of views that see background through each, int [n]."""

    def drop(self, gone: np.ndarray) -> None:
        if gone.any():
            kept = ~gone
            self.index, self.centres, self.misses = self.index[kept], self.centres[:, kept], self.misses[kept]


BLOCK = 24


def _blocks(bounds: np.ndarray, cells: int) -> list[_Block]:
    side = (bounds[1] - bounds[0]) / cells
    starts = range(0, cells, BLOCK)
    blocks = []
    for corner in itertools.product(starts, starts, starts):
        axes = [np.arange(first, min(first + BLOCK, cells)) for first in corner]
        place = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(3, -1)
        centres = (bounds[0][:, None] + (place + 0.5) * side[:, None]).astype(np.float32)
        index = (place[0] * cells + place[1]) * cells + place[2]
        blocks.append(_Block(index, centres, np.zeros(len(index), dtype=np.int32)))
    return blocks


def carved(bounds: np.ndarray, occupied: np.ndarray) -> np.ndarray:
    """Return the smallest box [2, 3] around the occupied cells of `bounds`; `bounds` itself if there are none."""
    if not occupied.any():
        return bounds
    cells = np.array(occupied.shape)
    ends = [np.flatnonzero(occupied.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
    side = (bounds[1] - bounds[0]) / cells
    lower, upper = np.array([end[0] for end in ends]), np.array([end[-1] + 1 for end in ends])
    return np.stack([bounds[0] + lower * side, bounds[0] + upper * side])
