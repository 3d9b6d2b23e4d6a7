"""The attention of every region, from the object of a viewer's attention."""

from collections.abc import Callable
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from baselines.numerics.attention.maps import MAPS, MapInputs
from baselines.numerics.attention.regions import Regions

RADIUS = 0.2
"""The radius of the disc about a point, as a share of the picture's longer side."""

ATTENTIONS: dict[str, str] = {
    "foveal": "fovea at the point of interest",
    "point": "disc about the pointer",
    "gradients": "gradients of the coarse frame",
    "error": "estimated error of the coarse frame",
    "none": "none (plain)",
}
"""Name of a map (`baselines.numerics.attention.maps.MAPS`), or none → its label on the page."""


Share = Annotated[float, Meta(ge=0, le=1)]


class Attention(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A point (`foveal`, `point`), a property of the coarse frame (`gradients`, `error`), or nothing."""

    kind: Literal["foveal", "point", "gradients", "error", "none"] = "foveal"
    row: Share = 0.5
    """From 0 at the top to 1 at the bottom."""
    column: Share = 0.5


def attention_map(
    attention: Attention, regions: Regions, focal: float, image: np.ndarray, error: Callable[[], np.ndarray]
) -> np.ndarray:
    """Return float64 [regions] from the coarse frame [h, w, 3], its `error()` [h, w], and `focal` in pixels."""
    if attention.kind == "none":
        return np.ones(regions.count)
    row, column = attention.row * regions.height, attention.column * regions.width
    radius = RADIUS * max(regions.height, regions.width)
    return MAPS[attention.kind](MapInputs(regions, row, column, radius, focal, image=lambda: image, error=error))
