"""Interpolation of learnt features of three planes and of hash tables, and its gradient, compiled for the processor.

One loop runs over the points, in registers and one resolution after the other, so that what it reads stays in the
cache; torch would walk over memory once for each of a dozen operations. Sums run in the order of the points, so that
the same input gives the same bits. `baselines.grids.planes.multiplied` and `baselines.grids.hash_grid.encoded` compose
the same from torch's operations: they are the oracles of the tests and run on a GPU. All compiled code is in this file,
as numba's cache would not see a change elsewhere.
"""

from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

PLANE_CHANNELS, TABLE_CHANNELS = 8, 2
"""The number of features of a node of a plane, and of an entry of a table, as constants for the compiler."""
PRIMES = (1, 2654435761, 805459861)
"""The factors of the hash of a node, Eq. 4 of Müller et al. 2022 (arXiv 2201.05989)."""
ONE, HALF = np.float32(1.0), np.float32(0.5)
SECOND, THIRD = np.uint32(PRIMES[1]), np.uint32(PRIMES[2])


@njit(inline="always")
@no_type_check
def _cell(x: float, cells: int) -> tuple[int, np.float32]:
    """Return the cell of a coordinate −1 … 1 and the position in it, 0 … 1; a point outside has those of the border."""
    at = min(max((x + ONE) * HALF * np.float32(cells), np.float32(0.0)), np.float32(cells))
    cell = min(np.int64(at), np.int64(cells - 1))
    return cell, at - np.float32(cell)


@njit(inline="always")
@no_type_check
def _on_plane(planes: np.ndarray, plane: int, i: int, u: float, j: int, v: float, c: int) -> float:
    along_0 = (ONE - v) * planes[plane, i, j, c] + v * planes[plane, i, j + 1, c]
    along_1 = (ONE - v) * planes[plane, i + 1, j, c] + v * planes[plane, i + 1, j + 1, c]
    return (ONE - u) * along_0 + u * along_1


@njit(inline="always")
@no_type_check
def _sum_on_plane(planes: np.ndarray, plane: int, i: int, u: float, j: int, v: float, c: int) -> float:
    """Return `_on_plane`, rounded as `_add_to_plane` weights the four nodes."""
    return (
        (ONE - u) * (ONE - v) * planes[plane, i, j, c]
        + (ONE - u) * v * planes[plane, i, j + 1, c]
        + u * (ONE - v) * planes[plane, i + 1, j, c]
        + u * v * planes[plane, i + 1, j + 1, c]
    )


@njit(inline="always")
@no_type_check
def _add_to_plane(total: np.ndarray, plane: int, i: int, u: float, j: int, v: float, c: int, slope: float) -> None:
    total[plane, i, j, c] += (ONE - u) * (ONE - v) * slope
    total[plane, i, j + 1, c] += (ONE - u) * v * slope
    total[plane, i + 1, j, c] += u * (ONE - v) * slope
    total[plane, i + 1, j + 1, c] += u * v * slope


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _planes_forward(x: np.ndarray, planes: np.ndarray, out: np.ndarray, first: int) -> None:
    cells = planes.shape[1] - 1
    for point in range(x.shape[0]):
        i, u = _cell(x[point, 0], cells)
        j, v = _cell(x[point, 1], cells)
        k, w = _cell(x[point, 2], cells)
        for c in range(PLANE_CHANNELS):
            xy, xz = _on_plane(planes, 0, i, u, j, v, c), _on_plane(planes, 1, i, u, k, w, c)
            out[point, first + c] = xy * xz * _on_plane(planes, 2, j, v, k, w, c)


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _planes_backward(x: np.ndarray, planes: np.ndarray, gradient: np.ndarray, total: np.ndarray, first: int) -> None:
    """Add the gradient of the planes to `total`, given that of the features in the columns from `first` on."""
    cells = planes.shape[1] - 1
    for point in range(x.shape[0]):
        i, u = _cell(x[point, 0], cells)
        j, v = _cell(x[point, 1], cells)
        k, w = _cell(x[point, 2], cells)
        for c in range(PLANE_CHANNELS):
            xy, xz = _sum_on_plane(planes, 0, i, u, j, v, c), _sum_on_plane(planes, 1, i, u, k, w, c)
            yz = _sum_on_plane(planes, 2, j, v, k, w, c)
            g = gradient[point, first + c]
            _add_to_plane(total, 0, i, u, j, v, c, g * xz * yz)
            _add_to_plane(total, 1, i, u, k, w, c, g * xy * yz)
            _add_to_plane(total, 2, j, v, k, w, c, g * xy * xz)


class Multiplied(torch.autograd.Function):
    """The features [points, sizes × PLANE_CHANNELS] of points −1 … 1, differentiable once with respect to planes."""

    @staticmethod
    def forward(ctx: Any, x: Float[Tensor, "points 3"], *scales: Float[Tensor, "3 _ _ channels"]) -> Tensor:
        ctx.save_for_backward(x, *scales)
        out = np.empty((len(x), PLANE_CHANNELS * len(scales)), dtype=np.float32)
        for scale, planes in enumerate(scales):
            _planes_forward(x.numpy(), planes.detach().numpy(), out, scale * PLANE_CHANNELS)
        return torch.from_numpy(out)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, *scales = ctx.saved_tensors
        features = gradient.contiguous().numpy()
        totals = []
        for scale, planes in enumerate(scales):
            total = np.zeros(planes.shape, dtype=np.float32)
            _planes_backward(x.numpy(), planes.detach().numpy(), features, total, scale * PLANE_CHANNELS)
            totals.append(torch.from_numpy(total))
        return None, *totals


@njit(inline="always")
@no_type_check
def _entry(i: int, j: int, k: int, nodes: int, entries: int) -> int:
    """Return the entry of a node: by its number where the table has an entry for each node, else by its hash."""
    if nodes * nodes * nodes <= entries:
        return (i * nodes + j) * nodes + k
    # a product of two numbers of 32 bits has 64 here
    hashed = np.uint32(i) ^ np.uint32(np.uint32(j) * SECOND) ^ np.uint32(np.uint32(k) * THIRD)
    return np.int64(hashed % np.uint32(entries))


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _tables_forward(x: np.ndarray, table: np.ndarray, cells: int, out: np.ndarray, first: int) -> None:
    entries = table.shape[0]
    for point in range(x.shape[0]):
        i, u = _cell(x[point, 0], cells)
        j, v = _cell(x[point, 1], cells)
        k, w = _cell(x[point, 2], cells)
        a = b = np.float32(0.0)
        for corner in range(8):
            di, dj, dk = corner >> 2, (corner >> 1) & 1, corner & 1
            share = (u if di else ONE - u) * (v if dj else ONE - v) * (w if dk else ONE - w)
            entry = _entry(i + di, j + dj, k + dk, cells + 1, entries)
            a += share * table[entry, 0]
            b += share * table[entry, 1]
        out[point, first] = a
        out[point, first + 1] = b


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _tables_backward(x: np.ndarray, gradient: np.ndarray, cells: int, total: np.ndarray, first: int) -> None:
    """Add the gradient of a table to `total`, given that of the features in the columns from `first` on."""
    entries = total.shape[0]
    for point in range(x.shape[0]):
        i, u = _cell(x[point, 0], cells)
        j, v = _cell(x[point, 1], cells)
        k, w = _cell(x[point, 2], cells)
        a, b = gradient[point, first], gradient[point, first + 1]
        for corner in range(8):
            di, dj, dk = corner >> 2, (corner >> 1) & 1, corner & 1
            share = (u if di else ONE - u) * (v if dj else ONE - v) * (w if dk else ONE - w)
            entry = _entry(i + di, j + dj, k + dk, cells + 1, entries)
            total[entry, 0] += share * a
            total[entry, 1] += share * b


class Encoded(torch.autograd.Function):
    """The features [points, levels × TABLE_CHANNELS] of points −1 … 1, differentiable once with respect to tables."""

    @staticmethod
    def forward(
        ctx: Any,
        x: Float[Tensor, "points 3"],
        cells: tuple[int, ...],
        *tables: Float[Tensor, "_ channels"],
    ) -> Float[Tensor, "points features"]:
        ctx.cells, ctx.shapes = cells, [table.shape for table in tables]
        ctx.save_for_backward(x)
        out = np.empty((len(x), TABLE_CHANNELS * len(tables)), dtype=np.float32)
        for level, table in enumerate(tables):
            _tables_forward(x.numpy(), table.detach().numpy(), cells[level], out, level * TABLE_CHANNELS)
        return torch.from_numpy(out)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Float[Tensor, "points features"]) -> tuple[Tensor | None, ...]:
        (x,) = ctx.saved_tensors
        features = gradient.contiguous().numpy()
        totals = []
        for level, shape in enumerate(ctx.shapes):
            total = np.zeros(shape, dtype=np.float32)
            _tables_backward(x.numpy(), features, ctx.cells[level], total, level * TABLE_CHANNELS)
            totals.append(torch.from_numpy(total))
        return None, None, *totals
