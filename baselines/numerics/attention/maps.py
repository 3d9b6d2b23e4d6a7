"""Maps of attention: each function returns the attention of every region, float64 [regions].

All raise `BadAttention`, naming region and value, for input that is not attention.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from baselines.numerics.attention.priorities import BadAttention
from baselines.numerics.attention.regions import Regions

HALF_ACUITY_DEGREES = 2.3
"""The eccentricity at which the eye resolves half as much as in the fovea's centre: e₂ of Geisler & Perry (1998)."""


def around_point(regions: Regions, row: float, column: float, radius: float) -> np.ndarray:
    """Return 1 / (1 + (distance / radius)²) about a point of interest in pixels, as `CONVENTIONS.md` counts them.

    It is half at `radius`, and falls slowly enough that regions are ordered by their distance everywhere.
    """
    _require_point(row, column)
    if not (math.isfinite(radius) and radius > 0.0):
        raise BadAttention(f"point of interest: radius {radius:g} px; must be finite and above 0")
    down, right = _offsets(regions, row, column)
    return mean_attention(regions, 1.0 / (1.0 + (down / radius) ** 2 + (right / radius) ** 2), "point of interest")


def foveal(regions: Regions, row: float, column: float, focal: float) -> np.ndarray:
    """Return the acuity of an eye that looks at a point of the picture, relative to its maximum: 1 / (1 + e / e₂).

    e is a pixel's eccentricity in degrees, the angle at the camera between its ray and that of the gaze point. It is
    the eye's eccentricity if the picture is seen from its centre of projection. The formula is the highest frequency
    seen at full contrast in Geisler & Perry (1998), "A real-time foveated multiresolution system for low-bandwidth
    video communication"; e₂ is `HALF_ACUITY_DEGREES`. `focal` is in pixels.
    """
    _require_point(row, column)
    if not (math.isfinite(focal) and focal > 0.0):
        raise BadAttention(f"fovea: focal length {focal:g} px; must be finite and above 0")
    centre = np.array([column - 0.5 * regions.width, row - 0.5 * regions.height, focal])
    down, right = _offsets(regions, 0.5 * regions.height, 0.5 * regions.width)
    down, right = np.broadcast_arrays(down, right)
    ray = np.stack([right, down, np.full_like(down, focal)], axis=-1)
    # the arc cosine of a scalar product would lose half of the digits near the centre
    angle = np.arctan2(np.linalg.norm(np.cross(ray, centre), axis=-1), ray @ centre)
    return mean_attention(regions, 1.0 / (1.0 + np.degrees(angle) / HALF_ACUITY_DEGREES), "fovea")


def from_gradients(regions: Regions, image: np.ndarray) -> np.ndarray:
    """Return the length of the gradient of an image [height, width] or [height, width, channels] over all channels, by
    central differences.
    """
    given = np.asarray(image, dtype=np.float64)
    slopes = [np.gradient(given, axis=axis) for axis in (0, 1) if given.shape[axis] > 1]
    square = sum((slope**2 for slope in slopes), np.zeros_like(given))
    return mean_attention(regions, np.sqrt(square.sum(axis=-1) if given.ndim == 3 else square), "gradient")


def _nothing() -> np.ndarray:
    raise BadAttention("there is nothing of that kind to look at here")


@dataclass(frozen=True)
class MapInputs:
    """The inputs of the maps. What must be rendered first is a callable, so that only the maps that use it render."""

    regions: Regions
    row: float
    column: float
    """The row and column of the gaze point, in pixels."""
    radius: float
    """The distance in pixels at which a point of interest has half of its attention."""
    focal: float
    """The focal length in pixels."""
    mask: Callable[[], np.ndarray] = _nothing
    """Returns the mask [height, width]."""
    image: Callable[[], np.ndarray] = _nothing
    """Returns a coarse frame [height, width, 3]."""
    error: Callable[[], np.ndarray] = _nothing
    """Returns an estimate of its error [height, width]."""


MAPS: dict[str, Callable[[MapInputs], np.ndarray]] = {
    "point": lambda inputs: around_point(inputs.regions, inputs.row, inputs.column, inputs.radius),
    "mask": lambda inputs: mean_attention(inputs.regions, inputs.mask(), "mask"),
    "gradients": lambda inputs: from_gradients(inputs.regions, inputs.image()),
    "error": lambda inputs: mean_attention(inputs.regions, inputs.error(), "estimated error"),
    "foveal": lambda inputs: foveal(inputs.regions, inputs.row, inputs.column, inputs.focal),
}
"""Every map by the name that records, the viewer and its address use."""


def mean_attention(regions: Regions, values: object, what: str) -> np.ndarray:
    """Average `values` [height, width], booleans or numbers ≥ 0, over each region. An invalid pixel is named."""
    given = np.asarray(values, dtype=np.float64)
    if given.shape != (regions.height, regions.width):
        raise BadAttention(f"{what} {list(given.shape)}: the picture is [{regions.height}, {regions.width}]")
    bad = ~(np.isfinite(given) & (given >= 0.0))
    if bad.any():
        row, column = divmod(int(bad.argmax()), regions.width)
        raise BadAttention(
            f"{what}: region {regions.of_pixel[row, column]} has {given[row, column]:g} at row {row}, column {column}; "
            "must be finite and not below 0"
        )
    return regions.mean(given)


def _require_point(row: float, column: float) -> None:
    if not (math.isfinite(row) and math.isfinite(column)):
        raise BadAttention(f"point at row {row:g}, column {column:g}: must be finite")


def _offsets(regions: Regions, row: float, column: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the offsets in pixels of pixel centres from a point: down [height, 1], to the right [1, width]."""
    down = np.arange(regions.height)[:, None] + 0.5 - row
    return down, np.arange(regions.width)[None, :] + 0.5 - column
