"""What a viewer attends to, as attention of every region."""

from dataclasses import dataclass

import numpy as np

from harness.attention.maps import around_point, foveal, from_gradients
from harness.attention.regions import Regions

RADIUS = 0.2
"""Of the disc about a point, of the picture's longer side."""

ATTENTIONS: dict[str, str] = {
    "foveal": "fovea at the point of interest",
    "point": "disc about the pointer",
    "gradients": "gradients of the coarse frame",
    "none": "none (plain)",
}
"""Kind → what a reader is shown."""


@dataclass(frozen=True)
class Attention:
    """What is attended: `foveal` and `point` about a point, `gradients` where the coarse frame has them, or nothing.

    Raises `ValueError` for another kind, and for a point that is not in the picture.
    """

    kind: str = "foveal"
    """Of `ATTENTIONS`."""
    row: float = 0.5
    """0 … 1 from top to bottom."""
    column: float = 0.5

    def __post_init__(self) -> None:
        if self.kind not in ATTENTIONS:
            raise ValueError(f"attention {self.kind!r}: choose one of {' '.join(ATTENTIONS)}")
        if not (0.0 <= self.row <= 1.0 and 0.0 <= self.column <= 1.0):
            raise ValueError(f"point of interest ({self.row}, {self.column}): both lie between 0 and 1")


def attention_map(attention: Attention, regions: Regions, focal: float, image: np.ndarray) -> np.ndarray:
    """float64 [regions]; `image` [h, w, 3] is the coarse frame, `focal` in pixels."""
    row, column = attention.row * regions.height, attention.column * regions.width
    if attention.kind == "foveal":
        return foveal(regions, row, column, focal)
    if attention.kind == "point":
        return around_point(regions, row, column, RADIUS * max(regions.height, regions.width))
    if attention.kind == "gradients":
        return from_gradients(regions, image)
    return np.ones(regions.count)
