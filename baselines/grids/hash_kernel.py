"""The multiresolution hash encoding (Müller et al. 2022, arXiv 2201.05989, § 3), compiled for the processor.

Level by level, so that the table of one level stays in the cache; within a level the sums run in the order of the
points, so the same input gives the same bits. `baselines.grids.hash_grid.encoded` composes the same from torch's
operations: its oracle in the tests, and what runs on a GPU.
"""

from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

CHANNELS = 2
"""The features of an entry, known to the compiler."""
PRIMES = (1, 2654435761, 805459861)
"""The factors of the hash of a node, Eq. 4 of the paper."""
ONE, HALF = np.float32(1.0), np.float32(0.5)
SECOND, THIRD = np.uint32(PRIMES[1]), np.uint32(PRIMES[2])


@njit(inline="always")
@no_type_check
def _cell(x: float, cells: int) -> tuple[int, np.float32]:
    """Return the cell of a coordinate −1 … 1 and how far into it the point lies; outside, the border counts."""
    at = min(max((x + ONE) * HALF * np.float32(cells), np.float32(0.0)), np.float32(cells))
    cell = min(np.int64(at), np.int64(cells - 1))
    return cell, at - np.float32(cell)


@njit(inline="always")
@no_type_check
def _entry(i: int, j: int, k: int, nodes: int, entries: int) -> int:
    """Return the entry of a node: its own where the table has one for each, else that of its hash."""
    if nodes * nodes * nodes <= entries:
        return (i * nodes + j) * nodes + k
    # a product of two numbers of 32 bits has 64 here
    hashed = np.uint32(i) ^ np.uint32(np.uint32(j) * SECOND) ^ np.uint32(np.uint32(k) * THIRD)
    return np.int64(hashed % np.uint32(entries))


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _forward(x: np.ndarray, table: np.ndarray, cells: int, out: np.ndarray, first: int) -> None:
    """Fill the columns of `out` from `first` on."""
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
def _backward(x: np.ndarray, gradient: np.ndarray, cells: int, total: np.ndarray, first: int) -> None:
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
    """The features [points, levels × CHANNELS] of points −1 … 1, differentiable once with respect to the tables."""

    @staticmethod
    def forward(
        ctx: Any,
        x: Float[Tensor, "points 3"],
        cells: tuple[int, ...],
        *tables: Float[Tensor, "_ channels"],
    ) -> Float[Tensor, "points features"]:
        ctx.cells, ctx.shapes = cells, [table.shape for table in tables]
        ctx.save_for_backward(x)
        out = np.empty((len(x), CHANNELS * len(tables)), dtype=np.float32)
        for level, table in enumerate(tables):
            _forward(x.numpy(), table.detach().numpy(), cells[level], out, level * CHANNELS)
        return torch.from_numpy(out)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Float[Tensor, "points features"]) -> tuple[Tensor | None, ...]:
        (x,) = ctx.saved_tensors
        features = gradient.contiguous().numpy()
        totals = []
        for level, shape in enumerate(ctx.shapes):
            total = np.zeros(shape, dtype=np.float32)
            _backward(x.numpy(), features, ctx.cells[level], total, level * CHANNELS)
            totals.append(torch.from_numpy(total))
        return None, None, *totals
