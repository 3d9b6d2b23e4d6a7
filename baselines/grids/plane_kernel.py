"""Features of three axis-aligned planes, multiplied: interpolation and its gradient, compiled for the processor.

One loop over points, all in registers; torch alone walks over memory once for each of a dozen operations. Sums run in
the order of the points, so the same input gives the same bits. `baselines.grids.planes.multiplied` composes the same
from torch's operations: its oracle in the tests, and what runs on a GPU.
"""

from typing import Any, no_type_check

import numpy as np
import torch
from jaxtyping import Float
from numba import njit
from torch import Tensor
from torch.autograd.function import once_differentiable

CHANNELS = 8
"""The features of a plane: known to the compiler, so that they fill one vector register."""
ONE, HALF = np.float32(1.0), np.float32(0.5)


@njit(inline="always")
@no_type_check
def _cell(x: float, size: int) -> tuple[int, np.float32]:
    """Return the cell of a coordinate −1 … 1 between `size` nodes, and how far into it the point lies; outside, the
    nearest point of the border counts.
    """
    at = min(max((x + ONE) * HALF * np.float32(size - 1), np.float32(0.0)), np.float32(size - 1))
    cell = min(np.int64(at), np.int64(size - 2))
    return cell, at - np.float32(cell)


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _forward(x: np.ndarray, planes: np.ndarray, out: np.ndarray, first: int) -> None:
    """Fill the columns of `out` from `first` on."""
    size = planes.shape[1]
    for point in range(x.shape[0]):
        i, u = _cell(x[point, 0], size)
        j, v = _cell(x[point, 1], size)
        k, w = _cell(x[point, 2], size)
        for c in range(CHANNELS):
            xy = (ONE - u) * ((ONE - v) * planes[0, i, j, c] + v * planes[0, i, j + 1, c]) + u * (
                (ONE - v) * planes[0, i + 1, j, c] + v * planes[0, i + 1, j + 1, c]
            )
            xz = (ONE - u) * ((ONE - w) * planes[1, i, k, c] + w * planes[1, i, k + 1, c]) + u * (
                (ONE - w) * planes[1, i + 1, k, c] + w * planes[1, i + 1, k + 1, c]
            )
            yz = (ONE - v) * ((ONE - w) * planes[2, j, k, c] + w * planes[2, j, k + 1, c]) + v * (
                (ONE - w) * planes[2, j + 1, k, c] + w * planes[2, j + 1, k + 1, c]
            )
            out[point, first + c] = xy * xz * yz


@njit(cache=True, error_model="numpy", nogil=True)
@no_type_check
def _backward(x: np.ndarray, planes: np.ndarray, gradient: np.ndarray, total: np.ndarray, first: int) -> None:
    """Add the gradient of the planes to `total`, given that of the features in the columns from `first` on."""
    size = planes.shape[1]
    for point in range(x.shape[0]):
        i, u = _cell(x[point, 0], size)
        j, v = _cell(x[point, 1], size)
        k, w = _cell(x[point, 2], size)
        u0v0, u0v1, u1v0, u1v1 = (ONE - u) * (ONE - v), (ONE - u) * v, u * (ONE - v), u * v
        u0w0, u0w1, u1w0, u1w1 = (ONE - u) * (ONE - w), (ONE - u) * w, u * (ONE - w), u * w
        v0w0, v0w1, v1w0, v1w1 = (ONE - v) * (ONE - w), (ONE - v) * w, v * (ONE - w), v * w
        for c in range(CHANNELS):
            xy = (
                u0v0 * planes[0, i, j, c]
                + u0v1 * planes[0, i, j + 1, c]
                + u1v0 * planes[0, i + 1, j, c]
                + u1v1 * planes[0, i + 1, j + 1, c]
            )
            xz = (
                u0w0 * planes[1, i, k, c]
                + u0w1 * planes[1, i, k + 1, c]
                + u1w0 * planes[1, i + 1, k, c]
                + u1w1 * planes[1, i + 1, k + 1, c]
            )
            yz = (
                v0w0 * planes[2, j, k, c]
                + v0w1 * planes[2, j, k + 1, c]
                + v1w0 * planes[2, j + 1, k, c]
                + v1w1 * planes[2, j + 1, k + 1, c]
            )
            g = gradient[point, first + c]
            to_xy, to_xz, to_yz = g * xz * yz, g * xy * yz, g * xy * xz
            total[0, i, j, c] += u0v0 * to_xy
            total[0, i, j + 1, c] += u0v1 * to_xy
            total[0, i + 1, j, c] += u1v0 * to_xy
            total[0, i + 1, j + 1, c] += u1v1 * to_xy
            total[1, i, k, c] += u0w0 * to_xz
            total[1, i, k + 1, c] += u0w1 * to_xz
            total[1, i + 1, k, c] += u1w0 * to_xz
            total[1, i + 1, k + 1, c] += u1w1 * to_xz
            total[2, j, k, c] += v0w0 * to_yz
            total[2, j, k + 1, c] += v0w1 * to_yz
            total[2, j + 1, k, c] += v1w0 * to_yz
            total[2, j + 1, k + 1, c] += v1w1 * to_yz


class Multiplied(torch.autograd.Function):
    """The features [points, planes × CHANNELS] of points −1 … 1 in planes of several sizes, differentiable once with
    respect to the planes.
    """

    @staticmethod
    def forward(ctx: Any, x: Float[Tensor, "points 3"], *scales: Float[Tensor, "3 _ _ channels"]) -> Tensor:
        ctx.save_for_backward(x, *scales)
        out = np.empty((len(x), CHANNELS * len(scales)), dtype=np.float32)
        for scale, planes in enumerate(scales):
            _forward(x.numpy(), planes.detach().numpy(), out, scale * CHANNELS)
        return torch.from_numpy(out)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        x, *scales = ctx.saved_tensors
        features = gradient.contiguous().numpy()
        totals = []
        for scale, planes in enumerate(scales):
            total = np.zeros(planes.shape, dtype=np.float32)
            _backward(x.numpy(), planes.detach().numpy(), features, total, scale * CHANNELS)
            totals.append(torch.from_numpy(total))
        return None, *totals
