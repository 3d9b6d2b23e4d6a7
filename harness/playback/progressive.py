"""A view in parts: a coarse frame, then region after region in some order."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import torch

from baselines.contract import Rendering
from baselines.numerics.attention.priorities import checked, is_equal, region_order
from baselines.numerics.attention.regions import Regions
from harness.training.batches import Camera
from harness.training.learner import Learner
from harness.training.scoring.evaluate import View, pixel_order

Order = Literal["attention", "raster"]
"""Regions by decreasing priority (Eq. 7), or row by row."""
LEAST_RAYS = 1024
"""The minimum number of rays per chunk, which small regions share: on one processor thread, chunks of 100 rays were six
times as slow as 2048, and those of 1024 rays 1.3 times (reduced profile, 100 × 100 pixels).
"""
NOT_BY_REGIONS = (
    "its density depends on which points share a chunk (a mean over them), so that rendering region after region would "
    "change the picture: it is rendered plainly, in chunks of pixels from the entire view"
)


@dataclass(frozen=True)
class Done:
    """Final pixels: flat indices [n], row by row, display colour float32 [n, 3], opacity and depth in scene units,
    float32 [n].
    """

    pixels: np.ndarray
    colour: np.ndarray
    opacity: np.ndarray
    depth: np.ndarray
    share: float
    """The share of the picture's rays that are done, including these."""
    network_evaluations: int
    """The evaluations for these pixels; those of a chunk with several regions are counted for the first."""


class Canvas:
    """A picture that is being filled in; at first all is background."""

    def __init__(self, height: int, width: int) -> None:
        shape = (height, width)
        self.view = View(np.ones((*shape, 3), np.float32), np.zeros(shape, np.float32), np.zeros(shape, np.float32))
        """The pixels so far; `put` changes them."""

    def put(self, done: Done) -> None:
        self.view.colour.reshape(-1, 3)[done.pixels] = done.colour
        self.view.opacity.reshape(-1)[done.pixels] = done.opacity
        self.view.depth.reshape(-1)[done.pixels] = done.depth


def why_plain(learner: Learner) -> str | None:
    """Return why this method is rendered plainly under any attention; None if it is not."""
    return None if learner.field.pointwise else NOT_BY_REGIONS


class CoarseFrame(NamedTuple):
    """A view of few rays, and their cost."""

    view: View
    rays: int
    network_evaluations: int


def coarse(learner: Learner, camera: Camera, stride: int, chunk: int, bins: int | None = None) -> CoarseFrame:
    """Render the middle pixel of each square of `stride` pixels, and fill the square with it.

    The rendered pixels are those of the full resolution: final for a pointwise method, to float32 rounding. Chunks hold
    pixels from the entire view, as in training; the picture of another method differs from the final one all the same.
    `bins` per ray replaces the learner's.
    """
    rows, columns = (
        np.minimum(np.arange(0, size, stride) + (stride - 1) // 2, size - 1) for size in (camera.height, camera.width)
    )
    pixels = (rows[:, None] * camera.width + columns).reshape(-1)
    mixed = pixel_order(len(pixels))
    rays = camera.rays(learner.device).chosen(torch.as_tensor(pixels)[mixed].to(learner.device))
    render = learner.render(rays, chunk, bins)
    index = np.empty(len(pixels), np.int64)
    index[mixed.numpy()] = np.arange(len(pixels))
    row, column = np.arange(camera.height) // stride, np.arange(camera.width) // stride
    of_pixel = index[row[:, None] * len(columns) + column]
    view = View(*(values[of_pixel] for values in _arrays(render)))
    return CoarseFrame(view, len(pixels), render.network_evaluations)


class ErrorEstimate(NamedTuple):
    """The difference of two coarse frames, root mean square over channels, float64 [height, width], and its cost."""

    error: np.ndarray
    rays: int
    network_evaluations: int


def estimated_error(learner: Learner, camera: Camera, fine: View, stride: int, chunk: int, bins: int) -> ErrorEstimate:
    """Estimate the quadrature's error: `fine`, the coarse frame with `bins` per ray, against one with half of them."""
    rough = coarse(learner, camera, stride, chunk, max(1, bins // 2))
    difference = fine.colour.astype(np.float64) - rough.view.colour.astype(np.float64)
    return ErrorEstimate(np.sqrt((difference**2).mean(axis=-1)), rough.rays, rough.network_evaluations)


def refine(
    learner: Learner,
    camera: Camera,
    regions: Regions,
    attention: np.ndarray,
    chunk: int,
    order: Order = "attention",
    least_rays: int = LEAST_RAYS,
) -> Iterator[Done]:
    """Yield every pixel of the view once, in `order`; only the order by attention uses `attention`.

    There is one `Done` per region; a chunk that holds several small regions yields several. Two cases are bit-identical
    with plain rendering, with one `Done` per chunk of `chunk` rays: equal attention in the order by attention, and a
    method that is not pointwise (`why_plain`). Otherwise the picture is that of plain rendering to float32 rounding.
    Raises `BadAttention` before anything is rendered, and `Diverged`.
    """
    attended = checked(attention, regions.count)
    if why_plain(learner) or (order == "attention" and is_equal(attended)):
        # the chunks of `harness.training.scoring.evaluate.render_view`
        mixed = pixel_order(camera.width * camera.height).numpy()
        chunks = [mixed[start : start + chunk] for start in range(0, len(mixed), chunk)]
        return _by_parts(learner, camera, chunks, 1, chunk)
    sequence = region_order(attended) if order == "attention" else np.arange(regions.count)
    parts = [regions.pixels(region) for region in sequence.tolist()]
    return _by_parts(learner, camera, parts, min(chunk, least_rays), chunk)


def _by_parts(learner: Learner, camera: Camera, parts: list[np.ndarray], at_least: int, chunk: int) -> Iterator[Done]:
    """Yield the pixels of each part; at least `at_least` rays share a chunk, except in the last one."""
    rays, total, done = camera.rays(learner.device), camera.width * camera.height, 0
    for together in _chunks(parts, at_least):
        pixels = np.concatenate(together)
        render = learner.render(rays.chosen(torch.as_tensor(pixels).to(learner.device)), chunk)
        colour, opacity, depth = _arrays(render)
        evaluations, start = render.network_evaluations, 0
        for some in together:
            stop = start + len(some)
            done += len(some)
            part = slice(start, stop)
            yield Done(some, colour[part], opacity[part], depth[part], done / total, evaluations)
            evaluations, start = 0, stop


def _chunks(parts: list[np.ndarray], at_least: int) -> Iterator[list[np.ndarray]]:
    together: list[np.ndarray] = []
    for part in parts:
        together.append(part)
        if sum(map(len, together)) >= at_least:
            yield together
            together = []
    if together:
        yield together


def _arrays(render: Rendering) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    colour, opacity, depth = (values.cpu().numpy() for values in (render.colour, render.opacity, render.depth))
    return colour, opacity, depth
