"""Pixels of training images drawn by attention: Eq. 7 over the regions of all images at once.

The map is made of the images alone, so that every method of a comparison gets the same rays.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Int
from torch import Tensor

from harness.attention.maps import from_gradients
from harness.attention.priorities import shares
from harness.attention.regions import Regions
from harness.seeds import generator_for
from harness.settings import ATTENDED_SHARE
from scenes.pixels import over_white

REGIONS_ACROSS = 25
"""Regions along the width of a training image, at least as wide as a pixel: 4 pixels of 100, 32 of 800."""


@dataclass(frozen=True)
class AttendedPixels:
    """A distribution over the pixels of all images."""

    regions: Regions
    until: np.ndarray
    """float64 [images · regions]: chance of all regions up to and with this one; a region's is its pixels' share of the
    attention (Eq. 7's priority over φ)."""

    @staticmethod
    def by_gradients(images: Iterable[np.ndarray]) -> "AttendedPixels":
        """Of straight RGBA images [height, width, 4] over white, looked at one at a time."""
        regions: Regions | None = None
        attention = []
        for rgba in images:
            height, width = rgba.shape[:2]
            regions = regions or Regions(height, width, max(1, width // REGIONS_ACROSS))
            attention.append(from_gradients(regions, over_white(rgba)) * regions.rays)
        if regions is None:
            raise ValueError("no image to attend to")
        return AttendedPixels(regions, _until(attention, regions))

    def draw(self, count: int, generator: torch.Generator) -> Int[Tensor, " count"]:
        """Pixels numbered through all images row by row, as `scenes.image_stack.ImageStack.pixels` takes them."""
        lots = torch.rand(3, count, generator=generator, dtype=torch.float64).numpy()
        image, region = np.divmod(np.searchsorted(self.until, lots[0], side="right"), self.regions.count)
        row, column = np.divmod(region, self.regions.columns)
        top, left = row * self.regions.tile, column * self.regions.tile
        rows = np.minimum(self.regions.tile, self.regions.height - top)
        columns = np.minimum(self.regions.tile, self.regions.width - left)
        row, column = top + (lots[1] * rows).astype(np.int64), left + (lots[2] * columns).astype(np.int64)
        return torch.from_numpy((image * self.regions.height + row) * self.regions.width + column)


def mixed(attended: AttendedPixels, pixels: int, count: int, seed: int | str, step: int) -> Int[Tensor, " count"]:
    """The pixels of a batch, of `pixels` that there are: `ATTENDED_SHARE` by attention, then the others by chance."""
    generator = generator_for(seed, step, "attended batch")
    by_attention = attended.draw(int(count * ATTENDED_SHARE), generator)
    return torch.cat([by_attention, torch.randint(pixels, (count - len(by_attention),), generator=generator)])


def _until(attention: list[np.ndarray], regions: Regions) -> np.ndarray:
    """Images of one colour alone are equal attention: each pixel has the same chance, not each region."""
    everything = np.concatenate(attention)
    chance = shares(everything if everything.max() > 0.0 else np.tile(regions.rays, len(attention)))
    until = np.cumsum(chance)
    return until / until[-1]
