"""What a bin more costs in each region: a sample in empty space is not evaluated, so that equal samples are not equal
work.
"""

from dataclasses import dataclass

import numpy as np
import torch

from harness.attention.progressive import coarse_pixels, over_squares
from harness.attention.regions import Regions
from harness.camera import Camera
from harness.evaluate import View
from harness.learner import Learner


@dataclass(frozen=True)
class RegionCost:
    by_region: np.ndarray
    """int [count], at least 1: evaluations of the network for all rays of each region, estimated, at `bins` a ray."""
    rays: int
    """Rendered to find out."""
    network_evaluations: int
    """Spent to find out."""
    view: View
    """The coarse frame that they are the pixels of."""


def evaluations_by_region(
    learner: Learner, camera: Camera, regions: Regions, stride: int, chunk: int, bins: int
) -> RegionCost:
    """By the coarse pixels of each region, a call for each: dear on a small machine, cheap in evaluations.

    A region without a coarse pixel is taken to cost as much a ray as the mean.
    """
    rays = camera.rays(learner.device)
    pixels = coarse_pixels(camera, stride).reshape(-1)
    region_of = regions.of_pixel.reshape(-1)[pixels]
    counts = np.bincount(region_of, minlength=regions.count)
    found = np.zeros(regions.count)
    colour = np.empty((len(pixels), 3), np.float32)
    opacity, depth = np.empty(len(pixels), np.float32), np.empty(len(pixels), np.float32)
    for region in np.flatnonzero(counts).tolist():
        here = np.flatnonzero(region_of == region)
        seen = learner.render(rays.chosen(torch.as_tensor(pixels[here]).to(learner.device)), chunk, bins)
        found[region] = seen.network_evaluations
        for whole, part in ((colour, seen.colour), (opacity, seen.opacity), (depth, seen.depth)):
            whole[here] = part.cpu().numpy()
    a_ray = np.where(counts > 0, found / np.maximum(counts, 1), found.sum() / len(pixels))
    estimate = np.maximum(1, np.round(a_ray * regions.rays)).astype(np.int64)
    return RegionCost(estimate, len(pixels), int(found.sum()), over_squares(camera, stride, colour, opacity, depth))
