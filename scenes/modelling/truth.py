"""The exact colour that a ray sees in a scene with a closed form, and the pixels that follow from it.

A scene's `truth` maps rays `(o, d)`, float64 [rays, 3] each, `d` unit, to `Seen`, without sampling or a renderer.
Rendered images and trained methods are compared with it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from scenes.view_sets.viewpoints import FOV_X_RADIANS


@dataclass(frozen=True)
class Seen:
    colour: np.ndarray
    """The linear radiance, float64 [rays, 3], premultiplied by `opacity`."""
    opacity: np.ndarray
    """The opacity, float64 [rays], 0 … 1."""
    depth: np.ndarray
    """The distance to the first surface, transparent or not, as in rendered depth; float64 [rays]; 0 without a hit."""

    @staticmethod
    def at(distance: np.ndarray, colour: np.ndarray) -> "Seen":
        """Return opaque surfaces of `colour` [rays, 3] at `distance` [rays]; nothing where it is inf."""
        hit = np.isfinite(distance)
        return Seen(np.where(hit[:, None], colour, 0.0), hit.astype(float), np.where(hit, distance, 0.0))


Truth = Callable[[np.ndarray, np.ndarray], Seen]


def pixel_rays(
    camera_to_world: np.ndarray,
    width: int,
    height: int,
    strata: int = 1,
    jitter: np.random.Generator | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and unit directions [height · strata, width · strata, 3] through an even grid in every pixel.

    With one stratum these are the rays through the pixel centres. With `jitter` each ray goes through a random point
    of its stratum: means are then unbiased, whereas those of a grid depend on its alignment with straight edges.
    """
    focal = 0.5 * width / math.tan(0.5 * FOV_X_RADIANS)
    row, column = np.indices((height * strata, width * strata)) + 0.5
    if jitter is not None:
        row, column = row + jitter.uniform(-0.5, 0.5, row.shape), column + jitter.uniform(-0.5, 0.5, row.shape)
    x, y = (column / strata - 0.5 * width) / focal, -(row / strata - 0.5 * height) / focal
    d = np.stack([x, y, -np.ones_like(x)], axis=-1) @ camera_to_world[:3, :3].T
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    return np.broadcast_to(camera_to_world[:3, 3], d.shape), d


def pixel_means(
    truth: Truth,
    camera_to_world: np.ndarray,
    width: int,
    height: int,
    strata: int = 8,
    jitter: np.random.Generator | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Render a view with a box filter: rgba [height, width, 4], linear and premultiplied, and depth [height, width],
    the mean over the pixel's hits, 0 if nothing was hit. Rays are those of `pixel_rays`.
    """
    o, d = pixel_rays(camera_to_world, width, height, strata, jitter=jitter)
    seen = truth(o.reshape(-1, 3), d.reshape(-1, 3))
    values = np.concatenate([seen.colour, np.stack([seen.opacity, seen.depth, seen.depth > 0], axis=-1)], axis=-1)
    means = values.reshape(height, strata, width, strata, 6).mean(axis=(1, 3))
    hits = means[..., 5]
    return means[..., :4], np.where(hits > 0, means[..., 4] / np.where(hits > 0, hits, 1.0), 0.0)
