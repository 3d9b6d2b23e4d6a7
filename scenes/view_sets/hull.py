"""The visual hull of posed silhouettes: the cells of a box in which something may be.

A cell is empty if training views look through it and see the background. So nothing has to be learnt to leave it out,
and no method can lose what lies in the other cells. Alphas of test views are never asked.
"""

from collections.abc import Iterable

import numpy as np
from scipy.ndimage import maximum_filter

CELLS = 96
"""The cells of a hull along each axis: about one per pixel of a picture 100 pixels wide."""
MISSES = 0.02
"""The share of the views that may see through a cell that is kept: one bad mask of fifty takes nothing away."""
LEAST_ALPHA = 0.5 / 255
"""The least alpha of a covered pixel: what an 8-bit image can tell from nothing."""
MARGIN = 1.0
"""The pixels by which a silhouette is widened beside half of a cell: an edge that falls between samples."""


def covered(alpha: np.ndarray, pixels: int) -> np.ndarray:
    """Return where an image [h, w] is covered, or is within `pixels` of it along either axis, bool [h, w]."""
    return maximum_filter(alpha >= LEAST_ALPHA, size=2 * pixels + 1, mode="constant", cval=False)


def hull(
    bounds: np.ndarray, alphas: Iterable[np.ndarray], camera_to_world: np.ndarray, focal: float, cells: int = CELLS
) -> np.ndarray:
    """Return the occupied cells bool [cells, cells, cells] of the box `bounds` [2, 3].

    `alphas` are the images [h, w] of the poses [n, 4, 4] in OpenGL axes; `focal` is in pixels. A cell that a view does
    not see, behind the camera or beside the picture, is not judged by that view.
    """
    lower, side = bounds[0], (bounds[1] - bounds[0]) / cells
    reach = 0.5 * float(np.linalg.norm(side))
    kept = np.arange(cells**3)
    index = np.stack(np.unravel_index(kept, (cells,) * 3), axis=-1)
    centre = (lower + (index + 0.5) * side).astype(np.float32)
    misses = np.zeros(len(kept), dtype=np.int32)
    allowed = int(MISSES * len(camera_to_world))
    for alpha, pose in zip(alphas, camera_to_world, strict=True):
        height, width = alpha.shape
        seen = (centre - pose[:3, 3].astype(np.float32)) @ pose[:3, :3].astype(np.float32)
        depth = -seen[:, 2]
        ahead = depth > 2.0 * reach
        if not ahead.any():
            continue
        scale = focal / np.where(ahead, depth, np.inf)
        column, row = seen[:, 0] * scale + 0.5 * width, 0.5 * height - seen[:, 1] * scale
        inside = ahead & (column >= 0) & (column < width) & (row >= 0) & (row < height)
        # the nearest cell of all is the largest in the picture
        widened = covered(alpha, int(np.ceil(reach * focal / (depth[ahead].min() - reach) + MARGIN)))
        place = np.where(inside, row, 0).astype(np.int64) * width + np.where(inside, column, 0).astype(np.int64)
        misses += inside & ~widened.ravel()[place]
        left = misses <= allowed
        if not left.all():
            kept, centre, misses = kept[left], centre[left], misses[left]
    occupied = np.zeros(cells**3, dtype=bool)
    occupied[kept] = True
    return occupied.reshape((cells,) * 3)


def carved(bounds: np.ndarray, occupied: np.ndarray) -> np.ndarray:
    """Return the smallest box [2, 3] around the occupied cells of `bounds`; `bounds` itself if there are none."""
    if not occupied.any():
        return bounds
    cells = np.array(occupied.shape)
    ends = [np.flatnonzero(occupied.any(axis=tuple({0, 1, 2} - {axis}))) for axis in range(3)]
    side = (bounds[1] - bounds[0]) / cells
    lower, upper = np.array([end[0] for end in ends]), np.array([end[-1] + 1 for end in ends])
    return np.stack([bounds[0] + lower * side, bounds[0] + upper * side])
