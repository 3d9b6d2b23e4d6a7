"""The maps of attention that are compared, each by a formula of the picture's size or of its coarse frame."""

from dataclasses import dataclass

import numpy as np

from harness.attention.maps import MAPS, Sight
from harness.attention.progressive import coarse, estimated_error
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
"""Map of `harness.attention.maps.MAPS` → what is attended to, in words."""
CENTRE = (1 / 2, 1 / 2)
LOOKED_AT = {"foveal": (1 / 3, 2 / 3)}
"""Row and column, of height and width; the centre by all others."""


@dataclass(frozen=True)
class Looked:
    """A view of a cell, its regions, and the stride of its coarse frame."""

    cell: TrainedCell
    camera: Camera
    regions: Regions
    stride: int
    bins: int
    """Samples a ray, of the coarse frame as well."""


def attention_of(kind: str, view: Looked, first: View | None = None) -> tuple[np.ndarray, int]:
    """float64 [regions], and the network evaluations that it cost; `first` is the coarse frame, which is rendered where
    it is needed and not given. Raises `ValueError` for an unknown kind.
    """
    if kind not in KINDS:
        raise ValueError(f"unknown map of attention {kind!r}; known: {' '.join(KINDS)}")
    learner, camera, chunk = view.cell.learner, view.camera, view.cell.chunk
    spent = 0

    def frame() -> View:
        nonlocal first, spent
        if first is None:
            first, _, evaluations = coarse(learner, camera, view.stride, chunk, view.bins)
            spent += evaluations
        return first

    def error() -> np.ndarray:
        nonlocal spent
        estimate = estimated_error(learner, camera, frame(), view.stride, chunk, view.bins)
        spent += estimate.network_evaluations
        return estimate.error

    row, column = LOOKED_AT.get(kind, CENTRE)
    sight = Sight(
        view.regions,
        row * camera.height,
        column * camera.width,
        0.25 * camera.width,
        camera.focal,
        mask=lambda: middle(camera.height, camera.width),
        image=lambda: frame().colour,
        error=error,
    )
    return MAPS[kind](sight), spent


def middle(height: int, width: int) -> np.ndarray:
    """bool [height, width]: pixels whose centre lies in the middle half of the rows and of the columns."""
    rows, columns = (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width
    return (np.abs(rows - 0.5) < 0.25)[:, None] & (np.abs(columns - 0.5) < 0.25)[None, :]
