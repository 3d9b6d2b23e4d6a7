"""Textures, lights and shapes that the scenes share; textures are not interpolated, so that their truth is exact."""

import numpy as np

from scenes.modelling.scene import Description
from scenes.modelling.surfaces import matte


def chequers(rows: int, columns: int, first: tuple[float, ...], second: tuple[float, ...]) -> np.ndarray:
    """Return chequers, float32 [rows, columns, 3], one pixel per field."""
    odd = np.indices((rows, columns)).sum(axis=0) % 2
    return np.where(odd[..., None] == 0, np.asarray(first), np.asarray(second)).astype(np.float32)


def patchwork(seed: int, rows: int, columns: int, low: float = 0.05, high: float = 0.95) -> np.ndarray:
    """Return float32 [rows, columns, 3]: random colours, so that no two fields look alike."""
    return np.random.default_rng(seed).uniform(low, high, (rows, columns, 3)).astype(np.float32)


def fields(pixels: np.ndarray) -> Description:
    return {"type": "bitmap", "data": pixels, "filter_type": "nearest", "raw": True}


def rgb(*values: float) -> Description:
    """Return one colour; a single value is a grey."""
    return {"type": "rgb", "value": list(values) * (3 if len(values) == 1 else 1)}


def sky(radiance: float = 1.0) -> Description:
    """Return equal light from everywhere: a convex matte body has its albedo times this as its radiance, exactly."""
    return {"type": "constant", "radiance": rgb(radiance)}


def glowing(radiance: Description) -> Description:
    return {"bsdf": matte(rgb(0.0)), "emitter": {"type": "area", "radiance": radiance}}


BLACK = matte(rgb(0.0))


def floor(half: float, height: float, **material: Description) -> Description:
    """Return the level square |x|, |y| ≤ half, facing up."""
    matrix = np.diag([half, half, 1.0, 1.0])
    matrix[2, 3] = height
    return {"type": "rectangle", "to_world": matrix, **material}
