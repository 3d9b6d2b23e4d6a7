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
    def rows(self) -> int:
        return -(-self.height // self.tile)

    @property
    def columns(self) -> int:
        return -(-self.width // self.tile)

    @property
    def count(self) -> int:
        return self.rows * self.columns

    @cached_property
    def of_pixel(self) -> NDArray[np.int64]:
        """Return the region of each pixel, [height, width]."""
        row, column = np.arange(self.height) // self.tile, np.arange(self.width) // self.tile
        return row[:, None] * self.columns + column[None, :]

    @cached_property
    def rays(self) -> NDArray[np.int64]:
        return np.bincount(self.of_pixel.reshape(-1), minlength=self.count)

    def corner(self, region: int) -> tuple[int, int, int, int]:
        """Return the first row, first column, height and width of a region in pixels."""
        row, column = divmod(region, self.columns)
        top, left = row * self.tile, column * self.tile
        return top, left, min(self.tile, self.height - top), min(self.tile, self.width - left)

    def pixels(self, region: int) -> np.ndarray:
        """Return the flat indices of its pixels, row by row."""
        top, left, height, width = self.corner(region)
        rows, columns = np.arange(top, top + height), np.arange(left, left + width)
        return (rows[:, None] * self.width + columns[None, :]).reshape(-1)

    def mean(self, values: np.ndarray) -> NDArray[np.float64]:
        """Average values [height, width] over each region, float64 [count].

        Equal values have exactly equal means, and the sum of large values does not overflow. The mean of values that
        are not finite is not finite.
        """
        given = np.asarray(values, dtype=np.float64)
        if given.shape != (self.height, self.width):
            raise ValueError(f"values {given.shape}, the picture is {self.height} × {self.width}")
        largest = float(np.abs(given).max())
        scale = largest if 0.0 < largest < np.inf else 1.0
        total = np.bincount(self.of_pixel.reshape(-1), (given / scale).reshape(-1), self.count)
        return total / self.rays * scale

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Return the values [count] of the regions for each pixel, [height, width]."""
        if np.shape(values) != (self.count,):
            raise ValueError(f"values {np.shape(values)}, there are {self.count} regions")
        spread: np.ndarray = np.asarray(values)[self.of_pixel]
        return spread
