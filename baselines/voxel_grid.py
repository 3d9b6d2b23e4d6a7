"""Numbers on a voxel grid, seen along rays, in Dr.Jit: interpolation, quadrature, compositing. Pure functions.

Importing this module imports Dr.Jit. Flat arrays run over voxels (x fastest), or over the points of rays, bin after bin
of a ray. `Any` stands for Dr.Jit's arrays, whose classes depend on the backend that is chosen when the program runs.
"""

from dataclasses import dataclass
from typing import Any

import drjit as dr

THIN = 0.05
"""Optical depth below which 1 − exp(−τ) is taken from its series, as Dr.Jit has no expm1: the terms left out are
below 3e-9 of it, while the difference would lose a digit for each power of ten."""


@dataclass(frozen=True)
class Corners:
    """The eight voxels around each point, and what each contributes."""

    index: list[Any]
    weight: list[Any]


def corners(unit: Any, shape: tuple[int, int, int]) -> Corners:
    """Of points in [0, 1]³ in a grid of `shape` (x, y, z) voxels; values live at voxel centres, the border is extended.

    The same interpolation as Mitsuba's `gridvolume` and torch's `grid_sample(align_corners=False,
    padding_mode="border")`.
    """
    integer = dr.int32_array_t(type(unit.x))
    low, high, share = [], [], []
    for position, voxels in zip(unit, shape, strict=True):
        at = position * voxels - 0.5
        below = dr.floor(at)
        low.append(dr.clip(integer(below), 0, voxels - 1))
        high.append(dr.clip(integer(below) + 1, 0, voxels - 1))
        share.append(at - below)
    index, weight = [], []
    for corner in range(8):
        upper = [bool(corner >> axis & 1) for axis in range(3)]
        x, y, z = (high[axis] if upper[axis] else low[axis] for axis in range(3))
        wx, wy, wz = (share[axis] if upper[axis] else 1.0 - share[axis] for axis in range(3))
        index.append((z * shape[1] + y) * shape[0] + x)
        weight.append(wx * wy * wz)
    return Corners(index, weight)


def interpolated(values: Any, at: Corners, kind: type) -> Any:
    """Of a flat array that holds one `kind` (a number, or a few side by side) a voxel."""
    return sum(
        weight * dr.gather(kind, values, dr.uint32_array_t(type(index))(index))
        for index, weight in zip(at.index, at.weight, strict=True)
    )


def softplus(x: Any) -> Any:
    """log(1 + exp x), without overflow."""
    return dr.maximum(x, 0.0) + dr.log(1.0 + dr.exp(-dr.abs(x)))


def sigmoid(x: Any) -> Any:
    return 1.0 / (1.0 + dr.exp(-x))


def lost(tau: Any) -> Any:
    """1 − exp(−τ) to all digits, and differentiable as such."""
    series = tau * (1.0 - tau * (1 / 2 - tau * (1 / 6 - tau * (1 / 24 - tau * (1 / 120 - tau / 720)))))
    thin = tau < THIN
    return dr.select(thin, series, 1.0 - dr.exp(-dr.select(thin, 1.0, tau)))


def ray_weights(tau: Any, bins: int) -> tuple[Any, Any]:
    """Eq. 6: the weight of each point, and the transmittance behind the last one of each ray."""
    before = dr.block_prefix_reduce(dr.ReduceOp.Add, tau, bins, exclusive=True)
    return dr.exp(-before) * lost(tau), dr.exp(-dr.block_reduce(dr.ReduceOp.Add, tau, bins))


def over_rays(values: Any, bins: int) -> Any:
    """The sum over the points of each ray."""
    return dr.block_reduce(dr.ReduceOp.Add, values, bins)
