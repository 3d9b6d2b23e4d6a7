"""The maps of attention that are compared, each by a formula of the picture's size or of its coarse frame."""

from dataclasses import dataclass

import numpy as np

from harness.attention.maps import around_point, foveal, from_error, from_gradients, from_mask
from harness.attention.progressive import estimated_error
from harness.attention.regions import Regions
from harness.camera import Camera
from harness.evaluate import View
from harness.finished import TrainedCell

KINDS = {
    "point": "a point of interest in the picture's centre, half the attention a quarter of the width away",
    "mask": "a user's mask: the middle half of the rows and of the columns, a quarter of the picture",
    "gradients": "where the coarse frame changes",
    "error": "where half of the samples make another coarse frame",
    "foveal": "the acuity of an eye that looks at a third of the height and two thirds of the width",
}
"""Name → what is attended to, in words."""


@dataclass(frozen=True)
class Looked:
    """A view of a cell, its regions, and the stride of its coarse frame."""

    cell: TrainedCell
    camera: Camera
    regions: Regions
    stride: int
    bins: int
    """Samples a ray of the run."""


def attention_of(kind: str, view: Looked, first: View) -> np.ndarray:
    """float64 [regions]; `first` is the coarse frame. Raises `ValueError` for an unknown kind."""
    regions, camera = view.regions, view.camera
    height, width = camera.height, camera.width
    if kind == "point":
        return around_point(regions, 0.5 * height, 0.5 * width, 0.25 * width)
    if kind == "mask":
        return from_mask(regions, middle(height, width))
    if kind == "gradients":
        return from_gradients(regions, first.colour)
    if kind == "error":
        cell = view.cell
        estimate = estimated_error(cell.learner, camera, view.stride, cell.chunk, view.bins)
        return from_error(regions, estimate.error)
    if kind == "foveal":
        return foveal(regions, height / 3, 2 * width / 3, camera.focal)
    raise ValueError(f"unknown map of attention {kind!r}; known: {' '.join(KINDS)}")


def middle(height: int, width: int) -> np.ndarray:
    """bool [height, width]: pixels whose centre lies in the middle half of the rows and of the columns."""
    rows, columns = (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width
    return (np.abs(rows - 0.5) < 0.25)[:, None] & (np.abs(columns - 0.5) < 0.25)[None, :]
