"""The attention of every region, from what a viewer attends to."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from baselines.numerics.attention.maps import MAPS, MapInputs
from baselines.numerics.attention.regions import Regions
from scenes.files.errors import InputError
from scenes.view_sets.images import read_image
from scenes.view_sets.pixels import area_weights

RADIUS = 0.2
"""The radius of the disc about a point, as a share of the picture's longer side."""

ATTENTIONS: dict[str, str] = {
    "foveal": "fovea at the point of interest",
    "point": "disc about the pointer",
    "gradients": "gradients of the coarse frame",
    "error": "estimated error of the coarse frame",
    "mask": "bright pixels of the mask",
    "none": "none (plain)",
}
"""Map of `baselines.numerics.attention.maps.MAPS` → the label for a reader."""
LARGEST_MASK = 1024
"""The most pixels per side that are kept of a mask."""


class Attention(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The object of attention: `foveal` and `point` about a point, `gradients` and `error` of the coarse frame, `mask`
    as marked by a user, or nothing.

    Raises `ValueError` for another kind, and for a point that is not in the picture.
    """

    kind: str = "foveal"
    """The kind, a key of `ATTENTIONS`."""
    row: float = 0.5
    """The place from 0 at the top to 1 at the bottom."""
    column: float = 0.5

    def __post_init__(self) -> None:
        if self.kind not in ATTENTIONS:
            raise ValueError(f"kind {self.kind!r}: choose one of {' '.join(ATTENTIONS)}")
        if not (0.0 <= self.row <= 1.0 and 0.0 <= self.column <= 1.0):
            where = f"row {self.row:g} and column {self.column:g} of the point of interest"
            raise ValueError(f"{where}: both lie between 0 and 1")


def attention_map(
    attention: Attention,
    regions: Regions,
    focal: float,
    image: np.ndarray,
    error: Callable[[], np.ndarray],
    mask: np.ndarray | None,
) -> np.ndarray:
    """Return float64 [regions]; `image` [h, w, 3] is the coarse frame, `error` returns an estimate of its error [h, w],
    `mask` is of any size, `focal` in pixels.
    """
    row, column = attention.row * regions.height, attention.column * regions.width
    if attention.kind == "none" or (attention.kind == "mask" and mask is None):
        return np.ones(regions.count)
    radius = RADIUS * max(regions.height, regions.width)
    marked = {} if mask is None else {"mask": lambda: spread(mask, regions.height, regions.width)}
    return MAPS[attention.kind](
        MapInputs(regions, row, column, radius, focal, image=lambda: image, error=error, **marked)
    )


def read_mask(file: Path) -> np.ndarray:
    """Read float64 [h, w], 0 … 1: the brightness of an image, over black where it is transparent.

    Raises `InputError` for a file that is no image, and for one that marks nothing.
    """
    try:
        image = read_image(file).astype(np.float64)
    except InputError as mistake:
        raise InputError(f"--mask {mistake}") from mistake
    grey = image.shape[-1] in (1, 2)
    bright = image[..., : 1 if grey else 3].mean(axis=-1)
    if image.shape[-1] in (2, 4):
        bright = bright * image[..., -1]
    if not np.isfinite(bright).all() or bright.min() < 0.0:
        raise InputError(f"--mask {file}: holds brightness that is not finite or below 0; save it as PNG")
    if bright.max() == 0.0:
        raise InputError(f"--mask {file}: is black all over; paint bright what is to be attended")
    return spread(bright, min(bright.shape[0], LARGEST_MASK), min(bright.shape[1], LARGEST_MASK))


def spread(mask: np.ndarray, height: int, width: int) -> np.ndarray:
    """Stretch a mask [h, w] over a picture: each pixel is the mean of its area."""
    rows = area_weights(mask.shape[0], height, mask.shape[0] / height)
    columns = area_weights(mask.shape[1], width, mask.shape[1] / width)
    return np.asarray(rows @ mask @ columns.T)
