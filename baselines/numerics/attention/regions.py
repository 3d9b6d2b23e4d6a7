"""A picture cut into square regions, each with one attention."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Regions:
    """Squares of `tile` pixels from the top left, row by row; the picture may cut those on the right and at the bottom.

    Raises `ValueError` for a picture or a tile without a pixel.
    """

    height: int
    width: int
    tile: int

    def __post_init__(self) -> None:
        if min(self.height, self.width, self.tile) < 1:
            raise ValueError(f"{self.height} × {self.width} pixels in tiles of {self.tile}: each must be at least 1")

    @property
    def columns(self) -> int:
        return -(-self.width // self.tile)

    @property
    def count(self) -> int:
        return -(-self.height // self.tile) * self.columns

    @cached_property
    def of_pixel(self) -> NDArray[np.int64]:
        """Return the region of each pixel, [height, width]."""
        row, column = np.arange(self.height) // self.tile, np.arange(self.width) // self.tile
        return row[:, None] * self.columns + column[None, :]

    @cached_property
    def rays(self) -> NDArray[np.int64]:
        return np.bincount(self.of_pixel.reshape(-1), minlength=self.count)

    def pixels(self, region: int) -> np.ndarray:
        """Return the flat indices of its pixels, row by row."""
        row, column = (place * self.tile for place in divmod(region, self.columns))
        rows = np.arange(row, min(row + self.tile, self.height))
        columns = np.arange(column, min(column + self.tile, self.width))
        return (rows[:, None] * self.width + columns[None, :]).reshape(-1)

    def mean(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Average values [height, width] over each region, float64 [count].

        Equal values have exactly equal means, and the sum of large values does not overflow. The mean of values that
        are not finite is not finite.
        """
        largest = float(np.abs(values).max())
        scale = largest if 0.0 < largest < np.inf else 1.0
        total = np.bincount(self.of_pixel.reshape(-1), (values / scale).reshape(-1), self.count)
        return total / self.rays * scale
