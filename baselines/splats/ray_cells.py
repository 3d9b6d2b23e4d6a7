"""The rays of a camera, as points of a plane sorted by cells, so that a Gaussian finds those it covers."""

import itertools
import math
from typing import NamedTuple, no_type_check

import numpy as np
from numba import njit


class RayCells(NamedTuple):
    """Points of a plane, sorted by the cells of a regular grid, with about one point per cell."""

    order: np.ndarray
    """The index of each sorted point before sorting, int [points]."""
    back: np.ndarray
    at: np.ndarray
    """The sorted points [2, points]."""
    start: np.ndarray
    """The first point of each cell, row by row, and the end, int [rows · columns + 1]."""
    rows: int
    columns: int
    lower: np.ndarray
    size: np.ndarray
    """The lower corner of the grid and the sides of a cell [2]."""

    @staticmethod
    def of(points: np.ndarray) -> "RayCells":  # [points, 2]
        points = np.ascontiguousarray(points.T)  # numpy is slow along a long first axis
        lower, upper = points.min(axis=1), points.max(axis=1)
        extent = np.maximum(upper - lower, 1e-12)
        square = (math.sqrt(points.shape[1] * extent[i] / extent[1 - i]) for i in range(2))
        columns, rows = (min(max(1, round(count)), points.shape[1]) for count in square)  # points may lie in a line
        size = (extent / (columns, rows)).astype(points.dtype)
        order, back = (np.empty(points.shape[1], np.int64) for _ in range(2))
        at, start = np.empty_like(points), np.zeros(rows * columns + 1, np.int64)
        _sort(points, lower, size, columns, order, back, at, start)
        return RayCells(order, back, at, start, rows, columns, lower, size)

    def bands(self, count: int) -> list[tuple[int, int]]:
        ends = [self.rows * i // count for i in range(count + 1)]
        return [(low, high) for low, high in itertools.pairwise(ends) if low < high]


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _sort(
    points: np.ndarray, lower: np.ndarray, size: np.ndarray, columns: int,
    order: np.ndarray, back: np.ndarray, at: np.ndarray, start: np.ndarray,
) -> None:  # fmt: skip
    """Fill the arrays of `RayCells`; points of one cell stay in their order."""
    cells, rows = np.empty(points.shape[1], np.int64), (start.shape[0] - 1) // columns
    for point in range(points.shape[1]):
        column = min(np.int64((points[0, point] - lower[0]) / size[0]), columns - 1)
        row = min(np.int64((points[1, point] - lower[1]) / size[1]), rows - 1)
        cells[point] = row * columns + column
        start[cells[point] + 1] += 1
    for cell in range(start.shape[0] - 1):
        start[cell + 1] += start[cell]
    free = start.copy()
    for point in range(points.shape[1]):
        place = free[cells[point]]
        free[cells[point]] += 1
        order[place], back[point] = point, place
        at[0, place], at[1, place] = points[0, point], points[1, point]
